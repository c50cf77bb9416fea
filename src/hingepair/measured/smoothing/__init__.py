"""Recordings smoothed and differentiated by splines, and read at other instants."""
