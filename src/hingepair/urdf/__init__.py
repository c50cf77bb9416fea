"""Robots as URDF describes them: links, joints, masses and shapes, as plain records.

Nothing here knows pairs or mechanisms, which are built from these records above. Imports rotations and what lies
below it.
"""
