"""The aircraft's aerodynamics: published data, the fit to them, and the JSBSim files that hold it."""
