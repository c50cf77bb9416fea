"""How a robot's tree is made: read from URDF, MJCF, a Pinocchio model or pairs, folded, and copied with changes."""
