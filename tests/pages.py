"""Scene nodes of pages, and messages of browsers."""

from typing import Any

from cspace.view import Viewer


def node(viewer: Viewer, name: str) -> Any:
    """Return the node of the scene with a name; None if there is none."""
    return viewer.server.scene.get_handle_by_name(name)


def setting(control: Any, value: float) -> dict[str, Any]:
    """Return the message of a browser that sets a control; its identifier is viser's own."""
    return {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": {"value": value}}
