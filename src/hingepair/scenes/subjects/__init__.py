"""What moves in a scene, a pair or a mechanism: its joints, its outputs and its forces."""
