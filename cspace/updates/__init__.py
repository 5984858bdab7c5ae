"""Changes of the workspace, followed by a map without a rebuild."""

from cspace.updates.outcome import Update as Update
