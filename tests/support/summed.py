"""What `hingepair run` says of a scene."""

from __future__ import annotations

from hingepair.cli.summary import RunSummary
from hingepair.scenes.scene import Scene


def summed(scene: Scene) -> RunSummary:
    """The summary of all pieces of a scene."""
    found = RunSummary(scene)
    for part in scene.blocks():
        found.add(part)
    return found
