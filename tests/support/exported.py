"""A robot as URDF text, and pairs at the corners of the formats."""

from __future__ import annotations

import math

import numpy as np

import hingepair as hp
from hingepair import euler_to_matrix
from support import states

ARM = """
<robot name="arm">
  <link name="base"/> <link name="upper"/> <link name="lower"/> <link name="hand"/> <link name="tool"/>
  <link name="camera"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/> <child link="upper"/> <origin xyz="0 0 1" rpy="0.1 -0.2 0.3"/> <axis xyz="0 0 2"/>
    <limit effort="1" velocity="1" lower="-1" upper="1"/>
  </joint>
  <joint name="elbow" type="continuous"> <parent link="upper"/> <child link="lower"/> <origin xyz="1 2 3"/> </joint>
  <joint name="follower" type="revolute">
    <parent link="lower"/> <child link="hand"/> <axis xyz="0 1e-200 0"/> <mimic joint="elbow"/>
    <limit effort="1" velocity="1"/>
  </joint>
  <joint name="slide" type="prismatic"> <parent link="hand"/> <child link="tool"/> <axis xyz="0 0 1"/>
    <limit effort="1" velocity="1" lower="-1" upper="1"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="upper"/> <child link="camera"/> <origin xyz="0.5 -0.5 0.25" rpy="0.4 0.5 -0.6"/>
  </joint>
</robot>
"""


def corner_pair(k, **change):
    """Axes along coordinates, a hair off them, or of any direction; homes of any kind, a third at pitch +-90."""
    rng = states.generator(84, k)
    u1, u2, n, home = states.pair(rng, home=k % 4 > 0)
    if k % 3 == 2:
        off = rng.choice([0.0, 1e-16, 1e-12, 1e-9, 1e-8, 1e-6]) * rng.normal()
        outer = rng.choice([0.0, math.pi, math.pi / 2, rng.uniform(-3, 3)], 2)
        home = euler_to_matrix((outer[0], rng.choice([-1, 1]) * math.pi / 2 + off, outer[1]), "xyz")
    if k % 5 < 2:
        n = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
        n = n + rng.choice([0.0, 1e-170, 1e-17, 1e-14, 1e-12, 1e-9]) * rng.normal(size=3)
    return hp.HingePair(**{"u1": u1, "u2": u2, "n": n, "home": home, "name": f"pair {k}"} | change)


WRITERS = {"mjcf": hp.to_mjcf, "urdf": lambda pair: hp.to_urdf(pair, base="floating")}
