"""Scene files: a pair or a robot, its motion, and the instants to compute."""
