"""Write gyro_log.csv and gyro_log_truth.csv: `python models/make_gyro_log.py [FOLDER]`.

The body turns by yaw, pitch and roll (about z, the new y, the newest x) that are sums of sines; so does the hinge.
A gyroscope on it, of twelve decimals and no noise, logs the angular velocity in the body's own axes a hundred times a
second; an encoder logs psi'. The truth is the attitude, as a quaternion, and psi, rounded once from 40 digits.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mpmath as mp

RATE, SECONDS = 100, 6
SINES = {  # amplitude, angular frequency of each sine
    "yaw": ((0.9, 1.1), (0.2, 3.7)),
    "pitch": ((0.5, 1.7), (-0.15, 2.9)),
    "roll": ((0.7, 2.3), (0.1, 4.1)),
    "psi": ((0.6, 1.9), (0.25, 3.1)),
}
LOG = "t,omega1_x,omega1_y,omega1_z,psid"
TRUTH = "t,qx,qy,qz,qw,psi"


def angle(name: str, t: mp.mpf) -> tuple[mp.mpf, mp.mpf]:
    """An angle and its rate."""
    pairs = [(mp.mpf(str(a)), mp.mpf(str(w))) for a, w in SINES[name]]
    return mp.fsum(a * mp.sin(w * t) for a, w in pairs), mp.fsum(a * w * mp.cos(w * t) for a, w in pairs)


def sample(k: int) -> tuple[str, str]:
    """The line of the log and that of the truth at t = k / RATE."""
    t = mp.mpf(k) / RATE
    (yaw, yaw_rate), (pitch, pitch_rate), (roll, roll_rate) = (angle(name, t) for name in ("yaw", "pitch", "roll"))
    psi, psid = angle("psi", t)
    omega = (
        roll_rate - yaw_rate * mp.sin(pitch),
        pitch_rate * mp.cos(roll) + yaw_rate * mp.cos(pitch) * mp.sin(roll),
        yaw_rate * mp.cos(pitch) * mp.cos(roll) - pitch_rate * mp.sin(roll),
    )
    (cz, sz), (cy, sy), (cx, sx) = ((mp.cos(a / 2), mp.sin(a / 2)) for a in (yaw, pitch, roll))
    quat = (
        cz * cy * sx - sz * sy * cx,
        cz * sy * cx + sz * cy * sx,
        sz * cy * cx - cz * sy * sx,
        cz * cy * cx + sz * sy * sx,
    )
    time = repr(k / RATE)
    return (
        ",".join([time, *(repr(float(mp.nint(x * 10**12) / 10**12)) for x in (*omega, psid))]),
        ",".join([time, *(repr(float(x)) for x in (*quat, psi))]),
    )


def main(folder: Path) -> None:
    """Write both files."""
    with mp.workdps(40):
        lines = [sample(k) for k in range(RATE * SECONDS + 1)]
    for name, header, i in (("gyro_log.csv", LOG, 0), ("gyro_log_truth.csv", TRUTH, 1)):
        text = "\n".join([header, *(line[i] for line in lines)]) + "\n"
        (folder / name).write_bytes(text.encode())


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
