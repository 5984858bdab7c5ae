"""Pages as tests look at them: what stands in the scene, and what browsers send."""

from typing import Any

from cspace.view import Viewer


def node(viewer: Viewer, name: str) -> Any:
    """What stands in the scene by a name; None if nothing does."""
    return viewer.server.scene.get_handle_by_name(name)


def setting(control: Any, value: float) -> dict[str, Any]:
    """What a browser sends when somebody sets a control; the name that it knows it by is viser's own."""
    return {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": {"value": value}}
