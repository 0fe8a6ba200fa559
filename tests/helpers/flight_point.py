"""The flight point of the maps and scenarios that tests write themselves."""

POINT = "[flight]\nmass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n"
