"""What moves in a scene: a pair or a mechanism, which answer the same calls."""

from __future__ import annotations

from typing import TypeAlias

from hingepair.scenes.subjects.mechanism import MechanismSubject
from hingepair.scenes.subjects.pair import PairSubject

Subject: TypeAlias = PairSubject | MechanismSubject
"""What moves in a scene."""
