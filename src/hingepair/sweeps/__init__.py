"""Many pairs and many motions: tolerance studies of a scene, and sweeps over the numbers of a scene or a robot."""
