"""Scenes of whole mechanisms: a robot or a tree of joints, the motion of its joints and base, the instants."""
