"""JSBSim's properties by name, each bound once."""

from collections.abc import Callable
from typing import Any


class Port:
    """Bind JSBSim properties by name, once; an unknown name raises KeyError instead of creating a property."""

    def __init__(self, fdm: Any):
        self._manager = fdm.get_property_manager()

    def node(self, name: str) -> Any:
        """Return JSBSim's node of property `name`; raises KeyError for one that there is not."""
        if not self._manager.hasNode(name):
            raise KeyError(f"JSBSim has no property {name!r}")
        return self._manager.get_node(name)

    def getter(self, name: str) -> Callable[[], float]:
        """Return the call that reads property `name`, in JSBSim's unit."""
        return self.node(name).get_double_value

    def setter(self, name: str) -> Callable[[float], None]:
        """Return the call that sets property `name`, in JSBSim's unit."""
        return self.node(name).set_double_value
