"""Noise parameters of a model.json in the words of the tools that use them.

A term that the log does not resolve is never filled in: a simulator gets 0, which switches it off,
a filter that cannot do without it gets no line; in either case a comment gives the bound that
stands. Each tool's own definition, and where it is written (tests/test_exports.py simulates them):

Kalibr, ``imu.yaml``
    Wiki page "IMU Noise Model"; ``ImuParameters`` in kalibr_common/ConfigReader.py, which wants all
    four numbers positive. One number per triad. Bias: a random walk, here ``Triad.mean(walk)``.
gnss-ins-sim
    ``IMU`` in sim/imu_model.py (deg/h, deg/sqrt(h), m/s/sqrt(h)); ``bias_drift`` in
    pathgen/pathgen.py: b_{k+1} = (1 - dt/T) b_k + sigma sqrt(1 - exp(-2 dt/T)) w, so b_stability is
    sigma_b; an infinite T gives white noise of that sigma instead. Starts at b = 0.
pyins (``python-ins``)
    ``inertial_sensor.Parameters`` and ``EstimationModel``: root densities, bias a random walk.
MATLAB ``imuSensor``
    ``gyroparams``, ``accelparams``; the step in IMUSensorSimulator.m has white noise
    NoiseDensity sqrt(F), random walk steps RandomWalk / sqrt(F), F = SampleRate / 2 for the default
    NoiseType 'double-sided' and SampleRate for 'single-sided': the latter is N and K, as MathWorks'
    example "Inertial Sensor Noise Analysis Using Allan Variance" says. BiasInstability drives the
    filter in BiasInstabilityCoefficients, by default 1 / (1 - z^-1 / 2), which forgets in two
    samples; with sqrt(1 - phi^2) / (1 - phi z^-1) it is the Gauss-Markov process exactly.
Gazebo classic (PX4 SITL)
    ``GazeboImuPlugin::addNoise`` in gazebo_imu_plugin.cpp: densities; bias exactly discretised with
    RandomWalk K and BiasCorrelationTime T_c, so sigma_b = K sqrt(T_c / 2). An element left out
    takes another sensor's value. Starts at b = 0.
Gazebo (gz-sim)
    ``GaussianNoiseModel::ApplyImpl`` of gz-sensors: stddev is of one sample, not a density (models
    that copied the classic densities simulate too little noise); dynamic_bias_stddev, its name
    notwithstanding, is the random walk K; the bias starts at N(bias_mean, bias_stddev).
"""

import numpy as np

from analysis.noise import conventions
from analysis.noise.triad import FOREVER, MISSING, read, said

TITLES = {
    "imu.yaml": "Kalibr: kalibr_calibrate_imu_camera --imu imu.yaml",
    "gnss_ins_sim_imu.py": "gnss-ins-sim: imu_model.IMU(accuracy=IMU_ERR, axis=6)",
    "pyins_imu.py": "pyins (python-ins): Parameters(**GYRO), EstimationModel(bias_sd=..., **GYRO)",
    "matlab_imu.m": "MATLAB: run it, then [accel, gyro] = imu(acceleration, angularVelocity)",
    "gazebo_classic_imu.sdf": "Gazebo classic, PX4 SITL: put this plugin into the model",
    "gz_sim_imu.sdf": "Gazebo (gz-sim), PX4 gz: put this sensor into the link",
}


def files(model):
    """Write every export of a model.json.

    Parameters
    ----------
    model : dict
        As `analysis.results.model` gives it, or json.load of the file.

    Returns
    -------
    dict
        File name -> text. README.md is always there, and alone where the log has no rate and no
        acceleration of one triad.

    Raises
    ------
    WrongUsage
        If it is not the content of a model.json.
    """
    triads, left_out = read(model)
    rate = float(model["source"]["rate_hz"])
    writers = (kalibr, gnss_ins_sim, pyins, matlab, gazebo_classic, gz_sim) if triads else ()
    about = said(model["source"], triads)
    texts = {}
    for name, writer in zip(TITLES, writers, strict=False):
        lines = [TITLES[name], *about] if not name.endswith("sdf") else about
        texts[name] = _ascii(writer(triads, rate, lines))
    return texts | {"README.md": _readme(model["source"], triads, left_out, rate, texts)}


def kalibr(triads, rate, about):
    """Kalibr's imu.yaml; a number that is not resolved has no line, and Kalibr will ask for it."""
    lines = _comment(about, "# ")
    lines += [
        "# One number per triad: root mean square over its resolved axes. Kalibr's bias is a",
        "# random walk; of a Gauss-Markov bias that is sigma_b sqrt(2 / T_c), good for t << T_c.",
    ]
    for sensor in ("accelerometer", "gyroscope"):
        triad = triads.get(sensor)
        white, walk = (
            triad.mean(what) if triad else None for what in (_white, lambda axis: axis.walk)
        )
        for key, value in ((f"{sensor}_noise_density", white), (f"{sensor}_random_walk", walk)):
            why = MISSING if triad else "not in this log"
            absent = f"# {key}: {why}; Kalibr cannot do without it, and this log cannot give it"
            lines.append(absent if value is None else f"{key}: {value:.6e}")
    return "\n".join([*lines, "rostopic: /imu0", f"update_rate: {rate:.6g}"]) + "\n"


def gnss_ins_sim(triads, rate, about):
    """Give the dict that gnss-ins-sim's IMU takes; deg/h, deg/sqrt(h), m/s^2, m/s/sqrt(h)."""
    lines = _comment(about, "# ")
    lines += [
        "# 0 switches a term off: not resolved, see above, or not in this log. gnss-ins-sim has",
        "# one Gauss-Markov bias an axis and no random walk beside it (a random walk alone is that",
        "# bias with a correlation time of 30 years). Needs a version whose pathgen.bias_drift has",
        "# sqrt(1 - exp(-2 dt / T)); before its issue #19 it had another factor.",
        "import numpy as np",
        "",
        "IMU_ERR = {",
    ]
    degrees = np.degrees(1.0)
    scales = (("gyro", "arw", 60 * degrees, 3600 * degrees), ("accel", "vrw", 60.0, 1.0))
    for sensor, (short, walk, white, bias) in zip(
        ("gyroscope", "accelerometer"), scales, strict=True
    ):
        process = _each(triads, sensor, lambda axis: axis.process)
        numbers = {
            "b": [0.0] * 3,
            walk: [white * (v or 0.0) for v in _each(triads, sensor, _white)],
            "b_stability": [bias * p[0] if p else 0.0 for p in process],
            "b_corr": [p[1] if p else np.inf for p in process],
        }
        lines += [f'    "{short}_{k}": np.array([{_python(v)}]),' for k, v in numbers.items()]
    return "\n".join([*lines, "}"]) + "\n"


def pyins(triads, rate, about):
    """Give keyword arguments for pyins.inertial_sensor.Parameters and EstimationModel, in SI."""
    lines = _comment(about, "# ")
    lines += [
        "# 0 switches a term off: not resolved, see above, or not in this log. pyins' bias is a",
        "# random walk; of a Gauss-Markov bias that is sigma_b sqrt(2 / T_c), good for t << T_c.",
        "# bias_sd of EstimationModel is left to you: how the bias differs from one switching on",
        "# to the next is not in a static log.",
    ]
    for name, sensor in (("GYRO", "gyroscope"), ("ACCEL", "accelerometer")):
        noise, walk = (
            _python([v or 0.0 for v in _each(triads, sensor, what)])
            for what in (_white, lambda axis: axis.walk)
        )
        lines.append(f'{name} = {{"noise": [{noise}], "bias_walk": [{walk}]}}')
    return "\n".join(lines) + "\n"


def matlab(triads, rate, about):
    """MATLAB script that makes an imuSensor."""
    lines = _comment(about, "% ")
    lines += [
        "% 0 switches a term off: not resolved, see above, or not in this log. 'single-sided' is",
        "% meant: with the default 'double-sided' imuSensor simulates N / sqrt(2) and K sqrt(2).",
        f"Fs = {rate:.9g};",
        "imu = imuSensor('accel-gyro', 'SampleRate', Fs);",
    ]
    for name, function, sensor in (
        ("Gyroscope", "gyroparams", "gyroscope"),
        ("Accelerometer", "accelparams", "accelerometer"),
    ):
        if sensor not in triads:
            lines.append(f"% imu.{name} stays ideal: there is no {sensor} in this log.")
            continue
        triad = triads[sensor]
        given = {"NoiseDensity": _white, "RandomWalk": lambda axis: axis.rrw.value}
        settings = ["'NoiseType', 'single-sided'"]
        settings += [f"'{k}', [{_vector(triad.each(v))}]" for k, v in given.items()]
        if any(axis.gauss_markov for axis in triad.axes.values()):
            lines += [
                "% One filter for three axes; each axis' own T_c is above.",
                f"phi = exp(-1 / (Fs * {triad.process[1]:.6e}));",
            ]
            sigma = [g[0][0] if g else None for g in triad.each(lambda a: a.gauss_markov)]
            settings += [
                f"'BiasInstability', [{_vector(sigma)}]",
                "'BiasInstabilityCoefficients', "
                "struct('Numerator', sqrt(1 - phi^2), 'Denominator', [1, -phi])",
            ]
        lines.append(f"imu.{name} = {function}( ...\n    " + ", ...\n    ".join(settings) + ");")
    return "\n".join(lines) + "\n"


def gazebo_classic(triads, rate, about):
    """Write the plugin element of Gazebo classic as PX4's SITL uses it."""
    lines = ['<plugin name="gazebo_imu_plugin" filename="libgazebo_imu_plugin.so">']
    lines += _xml(
        [TITLES["gazebo_classic_imu.sdf"], *about],
        "One number per triad: root mean square over its resolved axes. 0 switches a term off: "
        "not resolved, see above, or not in this log. An element left out would take the plugin's "
        "value for another sensor. TurnOnBiasSigma, how the bias differs from one switching on to "
        "the next, is not in a static log.",
    )
    lines += ["  <robotNamespace></robotNamespace>", "  <linkName>imu_link</linkName>"]
    for sensor in ("gyroscope", "accelerometer"):
        triad = triads.get(sensor)
        process = triad.process if triad else None
        numbers = {"NoiseDensity": (triad.mean(_white) if triad else None) or 0.0}
        numbers["RandomWalk"] = conventions.diffusion(*process) if process else 0.0
        numbers["BiasCorrelationTime"] = process[1] if process else FOREVER
        numbers["TurnOnBiasSigma"] = 0.0
        for name, value in numbers.items():
            lines.append(f"  <{sensor}{name}>{value:.6e}</{sensor}{name}>")
    return "\n".join([*lines, "</plugin>"]) + "\n"


def gz_sim(triads, rate, about):
    """Write the sensor element of gz-sim, with a noise element for each axis."""
    lines = ['<sensor name="imu_sensor" type="imu">']
    lines += _xml(
        [TITLES["gz_sim_imu.sdf"], *about],
        "stddev is N sqrt(update_rate): of one sample, for this rate only. dynamic_bias_stddev is "
        "K = sigma_b sqrt(2 / T_c). An axis without noise: not resolved, or not in this log.",
    )
    lines += [f"  <update_rate>{rate:.9g}</update_rate>", "  <imu>"]
    for sensor, element in (
        ("gyroscope", "angular_velocity"),
        ("accelerometer", "linear_acceleration"),
    ):
        axes = triads[sensor].axes if sensor in triads else {}
        lines.append(f"    <{element}>")
        for letter, axis in axes.items():
            numbers = {"mean": 0.0}
            if axis.white.resolved:
                numbers["stddev"] = conventions.per_sample(axis.white.value, 1 / rate)
            if axis.process:
                sigma, time = axis.process
                numbers |= {"bias_mean": 0.0, "bias_stddev": sigma if time < FOREVER else 0.0}
                numbers["dynamic_bias_stddev"] = conventions.diffusion(sigma, time)
                numbers["dynamic_bias_correlation_time"] = time
            if len(numbers) > 1:
                inner = "".join(f"<{k}>{v:.6e}</{k}>" for k, v in numbers.items())
                lines.append(f'      <{letter}><noise type="gaussian">{inner}</noise></{letter}>')
        lines.append(f"    </{element}>")
    return "\n".join([*lines, "  </imu>", "</sensor>"]) + "\n"


def _white(axis):
    return axis.white.value


def _each(triads, sensor, what):
    return triads[sensor].each(what) if sensor in triads else [None] * 3


def _python(values):
    return ", ".join("np.inf" if np.isinf(v) else f"{v:.6e}" for v in values)


def _vector(values):
    return " ".join(f"{v or 0.0:.6e}" for v in values)


def _comment(lines, mark):
    return [(mark + line).rstrip() for line in lines]


def _xml(lines, remark):
    text = [line.replace("--", "- -").rstrip("-") for line in (*lines, remark)]
    return ["  <!--", *(f"    {line}" for line in text), "  -->"]


def _ascii(text):
    return text.encode("ascii", "replace").decode()


def _readme(source, triads, left_out, rate, texts):
    lines = [f"# Noise of {source['file']} for other tools", ""]
    lines += [f"- `{name}` – {TITLES[name]}" for name in texts]
    lines += [f"- left out: {sentence}" for sentence in left_out]
    absent = [sensor for sensor in ("gyroscope", "accelerometer") if sensor not in triads]
    if not triads:
        lines.append("- no file: none of the tools can take this log")
    elif absent:
        lines.append(f"- no {absent[0]} in this log: its terms are off in the simulators")
    lines.append("- bias instability B is in no file: none of the tools has flicker noise as it is")
    unknown = [line for line in said(source, triads, why=True) if MISSING in line]
    if unknown:
        lines += ["", "What the log does not resolve, and so no file has:", ""]
        lines += [f"- {line}" for line in unknown]
    for triad in triads.values():
        sensors = {a.channel: _in_every_convention(a, triad, rate) for a in triad.axes.values()}
        lines += [
            "",
            f"## The {triad.sensor} in every convention",
            "",
            conventions.markdown(sensors),
        ]
    return "\n".join(lines) + "\n"


def _in_every_convention(axis, triad, rate):
    gyro = triad.sensor == "gyroscope"
    per = np.degrees(1.0) if gyro else 1.0
    sigma, time = axis.gauss_markov[0] if axis.gauss_markov else (np.nan, np.nan)
    white = axis.white.value if axis.white.resolved else np.nan
    unit = "°/s" if gyro else "m/s²"
    return conventions.side_by_side(per * white, per * sigma, time, 1 / rate, unit)
