"""A detector of the aircraft level over a recorded flight, with the parameters that the loop gives it."""

from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import sources
from cosim.flight.loop.signals import detect


def watched(detector, frame, fields, **parameters):
    """Return the log {field: (tick,)} of a detector over `frame`, with `parameters` in place of fitted ones."""
    p = detector.fitted(site(frame.attrs["dt"]))
    for name, value in parameters.items():
        p[name] = value
    return detect(frame, detector, sources(detector.DETECTOR.id), p, fields)
