"""A small road for tests of the command line, as the text of its file."""

SMALL = """
name = "small"

[road]
length_km = 2.0
cells = 20

[diagram]
kind = "greenshields"
free_flow_kmh = 90.0
jam_per_km = 150.0

[demand]
flow_vehph = 1500.0

[run]
duration_s = 240.0
locations_km = [0.5, 1.5]

[uncertain.free_flow_kmh]
distribution = "normal"
sd = 5.0

[uncertain.jam_per_km]
distribution = "lognormal"
sd = 10.0

[detectors]
position_km = [0.3, 1.0, 1.7]

[probe]
depart_s = 20.0

[ensemble]
cycles = 3
"""


def changed(*changes):
    """Return the text with pairs of old and new put in."""
    text = SMALL
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text
