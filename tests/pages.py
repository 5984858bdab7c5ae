"""Scene nodes of pages, and messages of browsers."""

from typing import Any

from cspace.view import Viewer


def node(viewer: Viewer, name: str) -> Any:
    """Return the scene node with a name, or None."""
    return viewer.server.scene.get_handle_by_name(name)


def setting(control: Any, value: float) -> dict[str, Any]:
    """Return the browser's message that sets a control."""
    return {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": {"value": value}}
