"""The log of a run: one self-contained MCAP file, written while the run goes on and read back bit for bit."""

from .format import LogError, Topic
from .foxglove import Pose
from .layouts import viewer_layouts
from .reader import Log, log_info, open_log
from .recover import recover
from .writer import LogWriter

__all__ = [
    "Log", "LogError", "LogWriter", "Pose", "Topic", "log_info", "open_log",
    "recover", "viewer_layouts",
]  # fmt: skip
