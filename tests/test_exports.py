"""Exports: simulated by each tool's own definition and fitted back; units; nothing made up."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pandas as pd
import pytest
import yaml
from pyins.inertial_sensor import EstimationModel, Parameters
from refused import refused

from analysis import CannotAnswer, WrongUsage
from analysis.noise import UnifiedModel, infer
from analysis.noise.parameters import random_walk_unit
from analysis.static_logs import stored
from workbench import exports

RATE, HOURS = 10.0, 6.0
DT = 1 / RATE
FACTORS = {"x": 1.0, "y": 1.3, "z": 0.8}
TRUTH = {  # SI: N, sigma_b, T_c of x, y, z, from the white noise of one sample
    sensor: {a: (k * white * DT**0.5, 0.2 * k * white, 80.0) for a, k in FACTORS.items()}
    for sensor, white in {"gyroscope": 1e-3, "accelerometer": 1e-2}.items()
}
NAMES = {"gyroscope": ("gyro", "rate", "arw"), "accelerometer": ("accel", "accel", "vrw")}
UNITS = {"gyroscope": "rad/s", "accelerometer": "m/s^2"}


# --- a model.json --------------------------------------------------------------------------------


def estimate(value, unit, *, low=None, high=None, note="for a reason"):
    """Write a parameter as model.json does; None is not resolved."""
    low, high = (low, high) if value is None else (0.9 * value, 1.1 * value)
    about = {"value": value, "low": low, "high": high, "resolved": value is not None}
    return about | {"unit": unit, "note": note}


def channel(sensor="gyroscope", axis="x", white=1e-4, sigma_b=None, corr_time=None, **more):
    """Write a channel of model.json in any unit, from values in SI."""
    (name, kind, walk), unit = NAMES[sensor], more.get("unit", UNITS[sensor])
    walks, size = (random_walk_unit(unit), f"{unit}/sqrt(s)"), exports.IN_SI[unit]
    known = {
        walk: (white, walks[0]),
        "rrw": (more.get("rrw"), walks[1]),
        "sigma_b": (sigma_b, unit),
    }
    parameters = {k: estimate(v and v / size, of, high=9.0 / size) for k, (v, of) in known.items()}
    parameters["corr_time"] = estimate(corr_time, "s", low=9.0)
    none = (("sigma_v", unit), ("bias_instability", unit), ("drift", f"{unit}/s"))
    parameters |= {key: estimate(None, of) for key, of in none}
    return {"name": f"{name}_{axis}", "unit": unit, "kind": kind, "parameters": parameters}


def model(*channels, unit=UNITS):
    """Write a model.json; by default one of the truth, with both triads."""
    truth = (channel(s, a, *v, unit=unit[s]) for s in TRUTH for a, v in TRUTH[s].items())
    source = {"file": "my.csv", "rate_hz": RATE, "duration_s": 3600 * HOURS}
    return {"source": source, "channels": list(channels or truth)}


def rms(values):
    """Give the mean that keeps power."""
    return np.sqrt(np.mean(np.square(values)))


def gyroscope(content, **given):
    """Sort the gyroscope of a model.json into x, y and z."""
    return exports.sort_triads(content, **given)[0]["gyroscope"]


# --- each file as its tool reads it, each tool as its source has it ------------------------------


def python(text):
    """Run an exported Python file."""
    names = {}
    exec(compile(text, "exported", "exec"), names)
    return names


def matlab(text):
    """Read gyroparams( ... ) and accelparams( ... ) as name -> value, phi among them."""
    found, lines = {}, [line for line in text.splitlines() if not line.startswith("%")]
    assert all(line.endswith((";", "...")) for line in lines)
    joined = re.sub(r"\.\.\.\n", " ", "\n".join(lines))
    assert joined.count("(") == joined.count(")") and joined.count("[") == joined.count("]")
    rate = float(re.search(r"Fs = (\S+);", joined)[1])
    for name, given in re.findall(r"imu\.(\w+) = \w+params\((.*)\);", joined):
        time = re.search(rf"phi = exp\(-1 / \(Fs \* (\S+)\)\);\s*imu\.{name}", joined)
        filtered = "struct('Numerator', sqrt(1 - phi^2), 'Denominator', [1, -phi])" in given
        assert filtered == (time is not None)
        numbers = re.findall(r"'(\w+)', \[([^\],]*)\]", given)
        read = {k: np.array(v.split(), dtype=float) for k, v in numbers}
        read["NoiseType"] = re.search(r"'NoiseType', '([\w-]+)'", given)[1]
        found[name.lower()] = read | {"phi": time and np.exp(-1 / (rate * float(time[1])))}
    return found


def gnss_ins_sim(texts, sensor, axis):
    """IMU.__init__ of sim/imu_model.py, then gyro_gen, acc_gen and bias_drift of pathgen.py."""
    given, i = python(texts["gnss_ins_sim_imu.py"])["IMU_ERR"], "xyz".index(axis)
    short, walk = ("gyro", "gyro_arw") if sensor == "gyroscope" else ("accel", "accel_vrw")
    d2r = np.pi / 180 if short == "gyro" else 1.0
    drift = given[f"{short}_b_stability"][i] * (d2r / 3600 if short == "gyro" else 1.0)
    time, white = given[f"{short}_b_corr"][i], given[walk][i] * d2r / 60 / np.sqrt(DT)
    step = drift * np.sqrt(1 - np.exp(-2 * DT / time))
    return {"white": white, "phi": 1 - DT / time, "step": step}


def imu_sensor(texts, sensor, axis):
    """IMUSensorSimulator.m: setupBandwidth, setStdDev*, step*Drift."""
    given, i = matlab(texts["matlab_imu.m"])[sensor], "xyz".index(axis)
    bandwidth = RATE / 2 if given["NoiseType"] == "double-sided" else RATE
    phi, sigma = given["phi"] or 0.0, given.get("BiasInstability", np.zeros(3))[i]
    white = np.sqrt(bandwidth) * given["NoiseDensity"][i]
    bias = {"phi": phi, "step": np.sqrt(1 - phi**2) * sigma}
    return {"white": white, "walk": given["RandomWalk"][i] / np.sqrt(bandwidth)} | bias


def gazebo_classic(texts, sensor, axis):
    """GazeboImuPlugin::addNoise."""
    root = ET.fromstring(texts["gazebo_classic_imu.sdf"])
    given = {e.tag.removeprefix(sensor): e.text for e in root}
    k, time = float(given["RandomWalk"]), float(given["BiasCorrelationTime"])
    assert float(given["TurnOnBiasSigma"]) == 0 < time
    step = np.sqrt(-k * k * time / 2.0 * (np.exp(-2.0 * DT / time) - 1.0))
    white = float(given["NoiseDensity"]) / np.sqrt(DT)
    return {"white": white, "phi": np.exp(-1 / time * DT), "step": step}


def gz_sim(texts, sensor, axis):
    """GaussianNoiseModel::Load and ApplyImpl."""
    root = ET.fromstring(texts["gz_sim_imu.sdf"])
    element = {"gyroscope": "angular_velocity", "accelerometer": "linear_acceleration"}[sensor]
    given = {e.tag: float(e.text) for e in root.iterfind(f"imu/{element}/{axis}/noise/*")}
    k, time = given.get("dynamic_bias_stddev", 0.0), given.get("dynamic_bias_correlation_time", 1.0)
    assert float(root.find("update_rate").text) == RATE
    step = np.sqrt(-k * k * time / 2 * np.expm1(-2 * DT / time))
    found = {"white": given.get("stddev", 0.0), "start": given.get("bias_stddev", 0.0)}
    return found | {"phi": np.exp(-DT / time), "step": step}


GAUSS_MARKOV = (gnss_ins_sim, imu_sensor, gazebo_classic, gz_sim)


def walk(y, sensor):
    """Fit a simulated log: N, K."""
    _, kind, white = NAMES[sensor]
    found = infer(y, DT, UNITS[sensor], kind, np.random.default_rng(1)).parameters
    return found[white], found["rrw"]


# --- round trips ---------------------------------------------------------------------------------


@pytest.mark.parametrize("tool", GAUSS_MARKOV, ids=lambda f: f.__name__)
@pytest.mark.parametrize("sensor", TRUTH)
def test_a_tool_gets_the_process_of_the_model(tool, sensor):
    """Analytic: the tool's recurrence, given the file, has N, sigma_b and T_c of the model."""
    texts = exports.files(model())
    for axis, (white, sigma, time) in TRUTH[sensor].items():
        got = tool(texts, sensor, axis)
        if tool is gazebo_classic:  # one number for three axes
            white, sigma, _ = map(rms, zip(*TRUTH[sensor].values(), strict=True))
        # 1e-3: gnss-ins-sim steps with 1 - dt/T_c for exp(-dt/T_c), which is dt / 2 T_c = 6e-4 off
        assert got["white"] * np.sqrt(DT) == pytest.approx(white, rel=1e-6)
        assert got["step"] / np.sqrt(1 - got["phi"] ** 2) == pytest.approx(sigma, rel=1e-3)
        assert -DT / np.log(got["phi"]) == pytest.approx(time, rel=1e-3)
        assert got.get("start", 0.0) in (0.0, pytest.approx(sigma, rel=1e-6))


def test_pyins_simulates_what_kalibr_and_pyins_are_told():
    """Cross-check: pyins itself simulates the exported triad; N and K come back."""
    texts, n = exports.files(model()), round(3600 * HOURS * RATE)
    told, given = python(texts["pyins_imu.py"]), yaml.safe_load(texts["imu.yaml"])
    assert given["update_rate"] == RATE
    still = pd.DataFrame(np.zeros((n, 3)), index=DT * np.arange(n))
    for name, sensor in (("GYRO", "gyroscope"), ("ACCEL", "accelerometer")):
        log = Parameters(**told[name], rng=5).apply(still, "rate").to_numpy()
        hits = np.zeros(2, dtype=int)
        for y, (white, sigma, time) in zip(log.T, TRUTH[sensor].values(), strict=True):
            truth = (white, sigma * np.sqrt(2 / time))
            found = zip(walk(y, sensor), truth, strict=True)
            hits += [e.resolved and e.low <= t <= e.high for e, t in found]
        assert (hits >= 2).all(), (name, hits)
        EstimationModel(bias_sd=1.0, **told[name])  # takes the same words
        # Kalibr's wiki, "IMU Noise Model": white sigma / sqrt(dt), bias steps sigma_b sqrt(dt).
        for key, of in (("noise_density", "noise"), ("random_walk", "bias_walk")):
            assert given[f"{sensor}_{key}"] == pytest.approx(rms(told[name][of]), rel=1e-6)


def test_a_random_walk_alone_reaches_every_tool():
    """Analytic: with K resolved and no Gauss-Markov term, each tool's bias steps by K sqrt(dt)."""
    k = 3e-6
    texts = exports.files(model(*(channel(axis=axis, rrw=k) for axis in "xyz")))
    for tool in (gnss_ins_sim, gazebo_classic, gz_sim):
        got = tool(texts, "gyroscope", "x")
        # 1e-4: Gazebo classic computes exp(-2e-10) - 1 with 1e-16 to spare
        assert got["step"] == pytest.approx(k * np.sqrt(DT), rel=1e-4)
        assert got["phi"] == pytest.approx(1.0, abs=1e-9) and got.get("start", 0.0) == 0.0
    assert imu_sensor(texts, "gyroscope", "x")["walk"] == pytest.approx(k * np.sqrt(DT), rel=1e-6)
    given = yaml.safe_load(texts["imu.yaml"].replace("# accel", "accel"))
    assert given["gyroscope_random_walk"] == pytest.approx(k, rel=1e-6)


# --- units ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("gyro", ["rad/s", "deg/s", "deg/h"])
@pytest.mark.parametrize("accel", ["m/s^2", "g", "mg"])
def test_the_unit_of_the_log_does_not_matter(gyro, accel):
    """Property: the same log in deg/s or rad/s, in g or m/s^2, gives the same files."""
    unit = {"gyroscope": gyro, "accelerometer": accel}
    found, expected = exports.files(model(unit=unit)), exports.files(model())
    number = r"\d+\.?\d*(?:e[-+]\d+)?"
    for name, text in expected.items():
        assert re.sub(number, "#", found[name]) == re.sub(number, "#", text)
        # What a tool reads has seven digits, what a reader reads four.
        for digits, pattern in ((2e-6, r"\d\.\d{6}e[-+]\d+"), (1e-3, number)):
            now, was = (re.findall(pattern, t) for t in (found[name], text))
            assert was or name == "README.md"
            np.testing.assert_allclose(np.array(now, float), np.array(was, float), rtol=digits)


def test_a_triad_mean_keeps_power():
    """Property: one number for three axes keeps the mean of N^2, of sigma_b^2 and of K^2.

    It is of the axes that are in the log; the others are off. With one T_c for three axes each
    keeps its K^2, and none is above its own Allan deviation: one had 3.3 times its K.
    """
    different = [("x", 1e-4, 1e-5, 50.0), ("y", 2e-4, 3e-5, 500.0), ("z", 3e-4, 2e-5, 200.0)]
    found = gyroscope(model(*(channel("gyroscope", *row) for row in different)))
    _, white, sigma, time = (np.array(column) for column in zip(*different, strict=True))
    assert found.mean("N") == pytest.approx(rms(white))
    mean_sigma, mean_time = found.process()
    assert mean_sigma == pytest.approx(rms(sigma))
    assert 2 * mean_sigma**2 / mean_time == pytest.approx(np.mean(2 * sigma**2 / time))
    assert min(time) < mean_time < max(time)
    texts = exports.files(model(*(channel("gyroscope", *row) for row in different)))
    for axis, _, own_size, own_time in different:
        got = imu_sensor(texts, "gyroscope", axis)
        size, time = got["step"] / np.sqrt(1 - got["phi"] ** 2), -DT / np.log(got["phi"])
        assert time == pytest.approx(50.0)
        assert size**2 / time == pytest.approx(own_size**2 / own_time)
        processes = (time, size), (own_time, own_size)
        adev, own = (UnifiedModel(1e-9, *of).adev(np.geomspace(1, 1e5, 40), DT) for of in processes)
        assert (adev <= own * (1 + 1e-5)).all()
    texts = exports.files(model(channel("gyroscope", *different[1])))
    assert python(texts["pyins_imu.py"])["GYRO"]["noise"] == pytest.approx([0.0, 2e-4, 0.0])
    assert yaml.safe_load(texts["imu.yaml"])["gyroscope_noise_density"] == pytest.approx(2e-4)
    assert "no accelerometer in this log" in texts["README.md"]


WHOLE = {"sigma_b": 1e-5, "corr_time": 50.0}


@pytest.mark.parametrize(("terms", "walk", "process"), [
    (WHOLE | {"rrw": 1e-6}, np.sqrt(1e-12 + 2e-10 / 50), (1e-5, 50.0)),
    ({"sigma_b": 1e-5}, None, None), ({"corr_time": 100.0}, None, None)])  # fmt: skip
def test_terms_of_one_model_add_in_power(terms, walk, process):
    """Analytic: at short times a Gauss-Markov bias and K are K^2 + 2 sigma_b^2 / T_c.

    Half a Gauss-Markov term, sigma_b without T_c, or T_c without sigma_b, is no process.
    """
    axis = gyroscope(model(channel("gyroscope", "x", 1e-4, **terms))).axes["x"]
    assert axis["walk"] == (walk and pytest.approx(walk))
    assert axis["sigma_b"] == (process and pytest.approx(process[0]))
    assert process is None or axis["corr_time"] == pytest.approx(process[1])


# --- what the log does not say -------------------------------------------------------------------


def test_nothing_unresolved_gets_a_number():
    """Property: with --strict an unresolved term is off, in Kalibr absent, named with its bound."""
    texts = exports.files(model(*(channel(axis=a, white=None) for a in "xyz")), strict=True)
    assert set(yaml.safe_load(texts["imu.yaml"])) == {"rostopic", "update_rate"}
    assert "# gyroscope_noise_density: not resolved" in texts["imu.yaml"]
    assert "# accelerometer_noise_density: not in this log" in texts["imu.yaml"]
    assert "imu.Accelerometer stays ideal" in texts["matlab_imu.m"]
    for tool in GAUSS_MARKOV:
        for sensor in list(TRUTH)[: 1 if tool is imu_sensor else 2]:
            with np.errstate(invalid="ignore"):
                got = tool(texts, sensor, "x")
            assert not any(got.get(k) for k in ("white", "step", "start", "walk")), tool.__name__
    told = python(texts["pyins_imu.py"])
    assert told["GYRO"] == told["ACCEL"] == {"noise": [0.0] * 3, "bias_walk": [0.0] * 3}
    for name in exports.TITLES:
        assert "gyro_y (y): N not resolved (at most 9)" in texts[name]
        assert "gyro_y (y): T_c not resolved (at least 9) s" in texts[name]
    assert "for a reason" in texts["README.md"]


def test_a_filter_gets_the_bound():
    """Property: Kalibr's four numbers are there, and say so where they are upper bounds."""
    text = exports.files(model(*[channel(s, a, None) for s in TRUTH for a in "xyz"]))["imu.yaml"]
    numbers = [key for key in yaml.safe_load(text) if key.endswith(("density", "walk"))]
    assert len(numbers) == 4 and text.count("# upper bound: not resolved") == 4
    assert yaml.safe_load(text)["gyroscope_random_walk"] == 9.0


@pytest.mark.parametrize("tool", GAUSS_MARKOV, ids=lambda f: f.__name__)
def test_a_tool_gives_the_curve_of_the_log_back(tool, monkeypatch):
    """cross-check: of an ADIS16405 axis with flicker noise every tool has the measured curve.

    Within 10 % at 1 to 600 s (9 % is what one Gauss-Markov process leaves); with --strict, white
    noise alone is four times too low. White noise gets no stand-in.
    """
    log = stored.read_model("adis16405")
    # Beside an axis that has K alone, no time constant; Gazebo classic has one number a triad.
    log["channels"] = log["channels"][: 1 if tool is gazebo_classic else 2]
    curve = {k: np.array(v) for k, v in log["channels"][0]["allan_line_removed"].items()}
    used = (curve["tau_s"] >= 1) & (curve["tau_s"] <= 600)
    monkeypatch.setattr("test_exports.DT", 1 / log["source"]["rate_hz"])
    monkeypatch.setattr("test_exports.RATE", log["source"]["rate_hz"])
    least = {}
    for strict in (False, True):
        texts = exports.files(log, strict=strict)
        got, tau = tool(texts, "gyroscope", "x"), curve["tau_s"][used]
        time = -DT / np.log(got["phi"]) if 0 < got["phi"] < 1 else 1.0
        sigma = got["step"] / np.sqrt(1 - got["phi"] ** 2) if got["phi"] < 1 else 0.0
        bias, walk_ = UnifiedModel(got["white"], time, sigma).adev(tau, DT), got.get("walk", 0.0)
        simulated = np.sqrt(bias**2 + walk_**2 / DT * tau / 3)
        ratio = simulated / np.radians(curve["deviation"][used])
        least[strict] = ratio.min()
        assert ratio.max() < 1.1 and ("stand-in" in texts["imu.yaml"]) == (not strict)
        alone = tool is gazebo_classic and not strict
        assert ("# of stand-ins" in texts["imu.yaml"]) == alone
    assert least[False] > 0.85 and least[True] < 0.4
    still = stored.read_model("mpu6050-gyro")
    assert exports.stand_in(still["channels"][1], still["source"], np.radians(0.00915)) is None


def test_what_is_fitted_beside_the_noise_is_in_no_stand_in():
    """property: with a step in the log the curve is that of the fitted noise, white here."""
    log = stored.read_model("adis16405")
    channel, source = log["channels"][0], log["source"]
    white = channel["parameters"]["sigma_v"]["value"]
    N = np.radians(white) / np.sqrt(source["rate_hz"])
    assert exports.stand_in(channel, source, N)[3] > 0.9
    channel["fit"]["terms"] = [{"kind": "step", "parameters": {}}]
    channel["models"] = [{"chosen": True, "terms": {"sigma_v": [white]}}]
    assert exports.stand_in(channel, source, N) is None
    channel["models"][0]["chosen"] = False
    refused(ValueError, "none of its models is chosen", exports.stand_in, channel, source, N)


def test_two_processes_have_a_stand_in():
    """property: files have room for one, and the longer alone would leave out the other."""
    log = stored.read_model("adis16405")
    channel, slow = log["channels"][0], {"sigma_b": 1e-3, "corr_time": 300.0}
    for key, value in slow.items():
        was = channel["parameters"][key]
        was |= {"value": value, "low": value / 2, "high": 2 * value, "resolved": True}
    for count, stands_in in ((1, []), (2, ["slow"])):
        terms = {key: [value] * count for key, value in slow.items()}
        channel["models"] = [{"chosen": True, "terms": terms | {"sigma_v": [1.0]}}]
        axis = gyroscope(log | {"channels": [channel]}).axes["x"]
        assert axis["stands_in"] == stands_in
        assert gyroscope(log | {"channels": [channel]}, strict=True).axes["x"]["stands_in"] == []


def test_a_filter_is_no_slow_noise():
    """property: white noise behind a low-pass, a bias of 0.2 s, is given as its plateau, once."""
    log, white = stored.read_model("mpu6050-gyro"), 0.01
    channel, tau = log["channels"][0], np.geomspace(0.1, 30.0, 20)
    for name, value in {"arw": None, "sigma_b": white / np.sqrt(0.4), "corr_time": 0.2}.items():
        channel["parameters"][name] |= {"value": value, "low": value, "high": value}
        channel["parameters"][name] |= {"resolved": value is not None}
    adev = white / np.sqrt(tau)
    curve = {"tau_s": tau, "deviation": adev, "low": 0.9 * adev, "high": 1.1 * adev}
    channel["allan_line_removed"] = {key: list(values) for key, values in curve.items()}
    axis = gyroscope(log | {"channels": [channel]}).axes["x"]
    assert axis["stands_in"] == ["N", "slow"] and axis["in_band"] == 1.0
    at_1_s = UnifiedModel(axis["N"] * 10, axis["corr_time"], axis["sigma_b"]).adev(1.0, 0.01)
    assert at_1_s == pytest.approx(np.radians(white), rel=0.1)


def test_a_stand_in_counts_where_no_axis_resolves_more():
    """property: one number a triad is of the axes that resolve their slow noise."""
    x = {"N": 1.0, "walk": 5.0, "sigma_b": 5.0, "corr_time": 2.0, "stands_in": ["slow"]}
    x["gauss_markov"] = 5.0
    y = {"N": 1.0, "walk": 1.0, "sigma_b": 1.0, "corr_time": 2.0, "stands_in": []}
    both = exports.Triad("gyroscope", {"x": x, "y": y})
    assert both.mean("walk") == 1.0 and both.process() == (1.0, 2.0) and both.mean("N") == 1.0
    y |= {"gauss_markov": None, "corr_time": exports.FOREVER}
    assert both.of_one_filter() == (2.0, [5.0, None, None])
    assert both.process()[1] == pytest.approx(exports.FOREVER)
    alone = exports.Triad("gyroscope", {"x": x})
    assert alone.mean("walk") == 5.0 and alone.process() == (5.0, 2.0)


def test_a_stand_in_replaces_nothing_that_is_resolved():
    """Property: with N unresolved, K stays; with a curve that has no numbers, nothing stands in."""
    log = stored.read_model("adis16405")
    log["channels"] = log["channels"][1:2]  # white noise, flicker noise and K
    own, known = log["channels"][0]["parameters"], gyroscope(log).axes["y"]
    own["arw"] |= {"value": None, "resolved": False}
    axis = gyroscope(log).axes["y"]
    assert all(axis[key] == known[key] for key in ("K", "walk", "sigma_b"))
    assert known["stands_in"] == [] and axis["stands_in"] == ["N"]
    assert pytest.approx(known["N"], rel=0.05) == axis["N"]
    curve = log["channels"][0]["allan_line_removed"]
    curve["low"] = [None] * len(curve["tau_s"])
    assert gyroscope(log).axes["y"]["N"] is None


@pytest.mark.parametrize("names, letters", [
    ("gyro_x gyro_y gyro_z", "xyz"), ("gz gx", "zx"), ("yaw_rate roll_rate pitch_rate", "zxy"),
    ("X-rate", "x"), ("a b c", "xyz"), ("a b c d", None), ("g1_x g2_x", None),
    ("trolley_gyro_x trolley_gyro_y", "xy"), ("gyr_y gyr_z gyr", None)])  # fmt: skip
def test_axes_are_told_by_name(names, letters):
    """Property: x, y, z or roll, pitch, yaw in the name; else the order of up to three."""
    triads, left_out = exports.sort_triads(model(*[channel() | {"name": n} for n in names.split()]))
    if letters is None:
        assert triads == {} and "not one triad" in left_out[0]
    else:
        found = {axis["channel"]: letter for letter, axis in triads["gyroscope"].axes.items()}
        assert found == dict(zip(names.split(), letters, strict=True))


def test_terms_beside_the_noise_are_listed_as_in_no_file():
    """property: README names what was fitted beside the noise, with its size, in its own unit."""
    one = channel(unit="deg/s")
    sizes = {"amplitude": estimate(0.2, "deg/s", note=""), "moment": estimate(400.0, "s", note="")}
    texts = exports.files(model(one | {"fit": {"terms": [{"kind": "step", "parameters": sizes}]}}))
    (said,) = (line for line in texts["README.md"].splitlines() if "amplitude" in line)
    assert said.startswith("- gyro_x: in no file is what was fitted")
    assert said.endswith("step amplitude 0.2 (0.18 to 0.22) deg/s, moment 400 (360 to 440) s")


def test_comments_cannot_break_a_file():
    """Property: names with line ends, dashes and letters beyond ASCII stay in comments."""
    wicked = model(channel())
    wicked["source"]["file"] = "ä---b--\nimport nothing; -->.csv"
    texts = exports.files(wicked)
    assert all(texts[name].isascii() for name in exports.TITLES)
    readers = {"sdf": ET.fromstring, "py": python, "m": matlab, "yaml": yaml.safe_load}
    for name in exports.TITLES:
        readers[name.split(".")[1]](texts[name])


def broken(path, value):
    """Give the model with one entry replaced."""
    *way, last = path
    whole = part = model()
    for key in way:
        part = part[key]
    part[last] = value
    return whole


ARW = ("channels", 0, "parameters", "arw")
NO_MODEL = (
    [], {}, {"channels": []}, broken(["source"], None), broken(["source", "rate_hz"], 0),
    broken(["source", "rate_hz"], "fast"), broken(["source", "duration_s"], float("nan")),
    broken(["channels", 0, "name"], None), broken(["channels", 0, "name"], ["x"]),
    broken(["channels", 0, "parameters"], {}), broken([*ARW, "low"], 1e9),
    broken([*ARW, "unit"], "deg/sqrt(h)"), broken([*ARW, "value"], None),
    broken([*ARW, "value"], "0.1"))  # fmt: skip


@pytest.mark.parametrize("wrong", [*NO_MODEL, {"sources": [], "seed": 1, "channels": []}])
def test_what_is_no_model_is_refused(wrong):
    """Property: one sentence, whatever is missing; what `pool` wrote is called by its name."""
    refused(WrongUsage, "this is a pooled" if "seed" in wrong else "no model", exports.files, wrong)


@pytest.mark.parametrize(("parameter", "key", "value"), [
    ("arw", "value", -1), ("arw", "value", "abc"), ("arw", "value", True),
    ("arw", "low", float("nan")), ("rrw", "high", float("inf")), ("sigma_b", "value", 1e200),
    ("corr_time", "value", 0)])  # fmt: skip
def test_a_number_that_cannot_be_is_named(tmp_path, parameter, key, value):
    """Property: an edited number is refused with file, channel and parameter; nothing written."""
    path = tmp_path / "edited.json"
    path.write_text(json.dumps(broken(["channels", 1, "parameters", parameter, key], value)))
    message = str(refused(WrongUsage, None, exports.export, path, tmp_path / "out"))
    said = f"{key} of {parameter} of gyro_y is {value!r}, not a number above zero that"
    assert message.startswith(f"{path}: ") and said in message
    assert not (tmp_path / "out").exists()


def test_export_of_a_file(tmp_path):
    """Property: every file is written, or none, which is said, and what was there stays."""
    path, out = tmp_path / "model.json", tmp_path / "deep" / "exports"
    path.write_text(json.dumps(model()))
    assert set(exports.export(path, out)) == {*exports.TITLES, "README.md"}
    assert {p.name for p in out.iterdir()} == {*exports.TITLES, "README.md"}
    (tmp_path / "README.md").write_text("# My robot")
    refused(WrongUsage, "name another folder", exports.export, path, tmp_path)
    angle, raw = {"kind": "angle", "name": "roll"}, {"unit": "LSB", "name": "raw"}
    none = model(channel() | angle, channel() | raw)
    (said,) = exports.files(none).values()  # README.md
    assert "roll is of kind angle" in said and "raw is in LSB" in said
    path.write_text(json.dumps(none))
    before = {p.name: p.read_bytes() for p in out.iterdir()}
    refused(CannotAnswer, r"nothing to export; .*roll is of kind angle", exports.export, path, out)
    assert {p.name: p.read_bytes() for p in out.iterdir()} == before
    for text in ("not JSON", "[1, 2]", "\xff"):
        path.write_text(text, encoding="latin-1")
        refused(WrongUsage, "no model", exports.export, path, out)
    refused(WrongUsage, "cannot be read", exports.export, tmp_path / "none.json", out)
