"""A track by integration from stance to stance.

Between two stances the acceleration is integrated to velocity and position. In a stance the foot
rests, so the velocity that is left there is error; it is taken to have grown evenly with time,
and is removed that way. With V and P the first and second integral of the acceleration since the
last stance, and T the time since then, the displacement is P(T) - V(T) T / 2, so nothing of the
swing has to be kept.

The stance is where the motion of `swing` is least between two swings, for runners too, whose
foot does not come to rest there: what it still moves is an error of the track. Where it does
come to rest, every sample of the rest is a stance, so standing for long costs nothing.
"""

import math

import numpy as np
from numba import njit

# The state of `integrate`, float64. Of the integrals since the last stance, and of the best
# candidate for the next stance since the last landing:
POSITION = slice(0, 3)  # at the last stance
NOW = slice(3, 9)  # V and P up to the last sample
BEST = slice(9, 15)  # V and P at the candidate
ACCELERATION = slice(15, 18)  # of the last sample
AGE = 18  # s since the last stance, of the last sample
BEST_AGE = 19
LEAST = 20  # motion of the candidate
SMOOTH = 21  # motion, averaged
HIGHEST = 22  # motion since the foot left the last stance
MOVING = 23
STARTED = 24
STATE_SIZE = 25


def new_state() -> tuple[np.ndarray, np.ndarray]:
    """State of a track that has not begun: float64 (25,), and the last stamp, int64 (1,)."""
    return np.zeros(STATE_SIZE), np.zeros(1, np.int64)


def last_stance(state: np.ndarray) -> np.ndarray | None:
    """Where the foot rests, (3,), or None while it swings. For the end of a recording."""
    if state[STARTED] == 0.0 or state[MOVING] != 0.0:
        return None
    velocity, way = state[BEST][:3], state[BEST][3:]
    return state[POSITION] + way - 0.5 * velocity * state[BEST_AGE]


@njit(cache=True)
def _set_down(state: np.ndarray) -> None:
    """Let the candidate be the stance: go on to it, and start the integrals from there."""
    now, best = state[NOW], state[BEST]
    age = state[BEST_AGE]
    since = state[AGE] - age
    for i in range(3):
        state[i] += best[3 + i] - 0.5 * best[i] * age
        now[3 + i] -= best[3 + i] + best[i] * since  # the velocity there is zero
        now[i] -= best[i]
    best[:] = 0.0
    state[AGE] = since
    state[BEST_AGE] = 0.0


@njit(cache=True)
def integrate(
    t: np.ndarray,
    acceleration: np.ndarray,
    rate: np.ndarray,
    constants: np.ndarray,
    state: np.ndarray,
    last: np.ndarray,
    row: np.ndarray,
    out: np.ndarray,
) -> int:
    """Find the position of each stance, when the foot leaves it.

    t: int64 (N,), stamps in ns; acceleration: (N, 3), east, north, up, without gravity, m/s^2;
    rate: (N, 3), rad/s.
    constants: (4,): weight of the rate (m/s^2 per rad/s), the motion below which all is rest
    (m/s^2), the ratio between swing and stance, and the time constant of the average (s).
    state, last: of `new_state()`, written.
    row: int64 (N,), out: (N, 3), written: the rows at which the foot left a stance, and where
    that was, in m from the first one.

    Returns the number of stances found.
    """
    weight, floor, ratio, smoothing = constants[0], constants[1], constants[2], constants[3]
    now, best, before = state[NOW], state[BEST], state[ACCELERATION]
    found = 0
    for k in range(len(t)):
        ax, ay, az = acceleration[k, 0], acceleration[k, 1], acceleration[k, 2]
        wx, wy, wz = rate[k, 0], rate[k, 1], rate[k, 2]
        turning = weight * weight * (wx * wx + wy * wy + wz * wz)
        motion = max(math.sqrt(ax * ax + ay * ay + az * az + turning), floor)
        if state[STARTED] == 0.0:
            state[STARTED] = 1.0
            state[SMOOTH] = state[LEAST] = motion
        else:
            dt = 1e-9 * (t[k] - last[0])
            for i in range(3):  # trapezoids
                mean = 0.5 * (before[i] + acceleration[k, i])
                now[3 + i] += (now[i] + 0.5 * mean * dt) * dt
                now[i] += mean * dt
            state[AGE] += dt
            state[SMOOTH] += (motion - state[SMOOTH]) * dt / (smoothing + dt)
        last[0] = t[k]
        before[:] = acceleration[k]
        smooth = state[SMOOTH]
        if state[MOVING] != 0.0:
            state[HIGHEST] = max(state[HIGHEST], smooth)
            if smooth < state[HIGHEST] / ratio:  # landed
                state[MOVING] = 0.0
                state[LEAST] = math.inf
        if state[MOVING] == 0.0:
            if smooth <= state[LEAST]:
                state[LEAST] = smooth
                state[BEST_AGE] = state[AGE]
                best[:] = now
                if motion == floor:  # at rest, so the foot stays where it is from here on
                    _set_down(state)
            elif smooth > state[LEAST] * ratio:  # left
                state[MOVING] = 1.0
                state[HIGHEST] = smooth
                _set_down(state)
                out[found] = state[POSITION]
                row[found] = k
                found += 1
    return found
