"""Conventions of this package: units, names, signs, and how it says no.

The notebooks in ``notebooks/`` tell the story; this package holds what two of them share or what
needs a test. Data flow one way only::

    data/ -> analysis.logs -> pure modules (noise, ...) -> notebooks -> analysis.figures -> figures/

Roads come in through analysis.roads in the place of analysis.logs.

The pure modules take and return arrays or small frozen dataclasses. They read no file and draw
no plot.

Units
-----
A reading keeps its own unit U (deg, deg/s, g, m ...), written with each number. Times are seconds.
Table columns carry their unit in their name: ``gyro_x_deg_s``, ``accel_z_g``, ``roll_deg``,
``north_m``.

======================  ===========================================================  ===========
name                    meaning                                                      unit
======================  ===========================================================  ===========
``tau``, ``dt``         averaging time of an Allan deviation, sampling interval      s
``adev``                overlapped Allan deviation (never "Allan variance")          U
``sigma_v``             wide-band noise: standard deviation of a single sample       U
``arw`` / ``vrw``       angle / velocity random walk N = sigma_v sqrt(dt), read on   U sqrt(s)
                        a rate / an acceleration
``sigma_b``             stationary standard deviation of the Gauss-Markov bias       U
``corr_time``           correlation time of the Gauss-Markov bias                    s
``bias_instability``    floor of the Allan deviation / 0.664 (IEEE 952)              U
``rrw``                 rate random walk K: adev = K sqrt(tau / 3)                   U/sqrt(s)
``drift``               slope of the straight line through the whole log             U/s
======================  ===========================================================  ===========

Three different things are called "bias instability" in practice (the IEEE 952 coefficient above,
the floor of the curve itself, the standard deviation of a Gauss-Markov bias). Here the words mean
the first; the third is ``sigma_b``.

Frames and signs
----------------
Body axes x forward, y right, z down; navigation axes north, east, down. Roll, pitch, yaw are the
3-2-1 Euler angles, positive right-handed about x, y, z. Angles are unwrapped before they are
analysed. ``C_nb`` turns a body vector into navigation axes: ``v_n = C_nb @ v_b``. Accelerometers
read specific force: ``accel_b`` of a level sensor at rest is (0, 0, -9.81) m/s^2. A mounting angle
is counted clockwise, seen from above, from the vehicle's heading to the sensor's X axis.

On a road ``s_m`` is the distance along its centre line in the direction of travel, from a gate.
Pitch is positive nose up, roll right side down, offset and curvature to the right.

Numbers
-------
An estimate carries a 95 % interval, or it is refused: ``resolved`` is False, ``value`` is None, and
``low`` or ``high`` still gives the bound the data do support. Random numbers come from a
``numpy.random.Generator`` that the caller hands in.
"""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "data"


class CannotAnswer(Exception):
    """The data cannot support an answer; the message says why (exit status 1)."""


class WrongUsage(Exception):
    """The question was put wrongly; the message says how to put it (exit status 2)."""
