"""The browser view: what is felt, thought and done; and touching with the mouse."""

from eskin.page import PageOrder, TouchOrder
from eskin.viewer.viewer import Viewer, ViewerConfig

__all__ = ["PageOrder", "TouchOrder", "Viewer", "ViewerConfig"]
