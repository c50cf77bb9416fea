"""Motions of scenes: by functions of time, rates, forces or a log, of a pair or of the joints of a robot."""
