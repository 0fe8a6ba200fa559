"""Physical constants and unit factors, named by direction."""
