"""Scene nodes of pages, and messages of browsers."""

from contextlib import contextmanager

import numpy as np
from scipy.spatial.transform import Rotation


def node(viewer, name):
    """Return the scene node with a name, or None."""
    return viewer.server.scene.get_handle_by_name(name)


def camera(**size):
    """Return the first message of a browser, of a square page by default."""
    sent = dict.fromkeys(("image_height", "image_width", "fov", "near", "far"), 1) | size
    sent |= dict.fromkeys(("position", "up_direction"), (0.0, 0.0, 1.0))
    sent |= {"look_at": (0.0, 0.0, 0.0), "wxyz": (1.0, 0.0, 0.0, 0.0)}
    return {"type": "ViewerCameraMessage", **sent}


def drag(name, poses):
    """Return the messages of a browser whose user drags a gizmo through poses, shape (n, 4, 4), and
    releases it."""
    updates = [
        {
            "type": "TransformControlsUpdateMessage",
            "wxyz": Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True).tolist(),
            "position": pose[:3, 3].tolist(),
        }
        for pose in np.asarray(poses)
    ]
    ends = [{"type": f"TransformControlsDrag{phase}Message"} for phase in ("Start", "End")]
    return [message | {"name": name} for message in (ends[0], *updates, ends[1])]


@contextmanager
def connected(viewer, **size):
    """Connect to a page as a browser does; give the function that sends its messages."""
    import msgspec
    import viser
    from websockets.sync.client import connect

    with connect(
        viewer.url.replace("http", "ws"),
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
    ) as client:

        def send(message):
            client.send(msgspec.msgpack.encode(message))

        send(camera(**size))
        yield send
