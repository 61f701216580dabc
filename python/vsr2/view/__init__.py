"""3-D replay of trials in a browser; needs no screen where it runs."""

from vsr2.view.live import LiveView
from vsr2.view.page import write_page
from vsr2.view.replay import Replay, load_replay
from vsr2.view.server import ReplayServer

__all__ = ["LiveView", "Replay", "ReplayServer", "load_replay", "write_page"]
