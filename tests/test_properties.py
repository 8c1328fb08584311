"""What holds of any input, and a smallest one that breaks it where one does (hypothesis)."""

import json
import shutil
import string
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from refused import csv_of, own_logs
from test_exports import broken
from test_grid import grid
from test_logs import HEADER, lines
from test_moving import clock, sentence

import sensorlogs
from analysis import CannotAnswer, WrongUsage, datasheets
from sensorlogs import catalogue, times
from workbench.cli import app, main

# The same inputs on every machine, and none kept from run to run.
settings.register_profile(
    "same everywhere", derandomize=True, database=None, deadline=None, max_examples=150,
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
settings.load_profile("same everywhere")

WHOLE = "\n".join([HEADER, *lines(100)]).encode()
PIECES = b', ; \n \t \0 " # nan -inf 1e999 1e-320 - \xff 12:00 2024-02-30 $GPGGA, {'.split(b" ")
PUT_IN = st.sampled_from(PIECES) | st.binary(max_size=3)
EDIT = st.tuples(st.integers(0, len(WHOLE)), st.integers(0, 60), PUT_IN)
EDITS = st.lists(EDIT, min_size=1, max_size=8)
KEY = st.text(max_size=8)
ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | KEY,
    lambda of: st.lists(of, max_size=3) | st.dictionaries(KEY, of, max_size=3), max_leaves=6,
)  # fmt: skip


def refusal(act, *names):
    """Give what an act returns, or the one sentence in which it refuses, which names its file."""
    try:
        return act()
    except (CannotAnswer, WrongUsage) as error:
        said = str(error)
        assert "\n" not in said.strip() and len(said) < 1500, said
        assert all(name in said for name in names), said
        return error


def answered(capsys, command):
    """Give status and error text of a command; one that failed wrote nothing, no traceback too."""
    shutil.rmtree("out", ignore_errors=True)
    status, said = main(command), capsys.readouterr().err
    assert status in (0, 1, 2) and "Traceback" not in said
    assert not status or not Path("out").exists()
    return status, said


@given(edits=EDITS, told=st.sampled_from([{}, {"rate": 100, "unit": "deg/s"}]))
def test_a_damaged_table_is_read_or_refused(tmp_path, edits, told):
    """property: whatever is put in, cut out or moved, at rest or in motion."""
    content = WHOLE
    for at, cut, piece in edits:
        content = content[:at] + piece + content[at + cut :]
    path = tmp_path / "my.csv"
    path.write_bytes(content)
    log = refusal(lambda: sensorlogs.read(path, **told), "my.csv")
    assert isinstance(log, Exception) or np.isfinite([log.rate_hz, log.duration_s]).all()
    refusal(lambda: sensorlogs.read_moving([path]), "my.csv")


@given(
    values=st.lists(st.floats(-1e6, 1e6), max_size=20, unique=True), comma=st.booleans(),
    name=st.sampled_from(["gyro_x_rad_s", "gyro_x_deg_s", "accel_x_m_s2", "accel_x_mg"]),
    delimiter=st.sampled_from(",;\t|"), form=st.sampled_from(["{!r}", "{:.17e}", "{:+.9f}"]),
)  # fmt: skip
def test_a_number_is_read_as_it_is_written(tmp_path, values, name, delimiter, comma, form):
    """property: whatever form, separator and decimal sign; from pandas 3 on to the last digit."""
    assume(not comma or delimiter in ";\t")
    values += np.random.default_rng(1).normal(size=90).tolist()
    written = [form.format(v) for v in values]
    rows = [f"{0.01 * i:.2f}{delimiter}{v}" for i, v in enumerate(written)]
    text = "\n".join([f"t_s{delimiter}{name}", *rows])
    (tmp_path / "my.csv").write_text(text.replace(".", ",") if comma else text)
    log = sensorlogs.read(tmp_path / "my.csv")
    rtol = 0 if pd.__version__ >= "3" else 1e-12
    np.testing.assert_allclose(log.channels[0].values, [*map(float, written)], rtol=rtol)


STEP = st.sampled_from([0.01] * 4 + [0, 0.0101, 0.02, 3, -0.01, np.nan])


@given(step=st.lists(STEP, min_size=1), seed=st.integers(0, 99))
def test_any_stamps_give_a_grid(step, seed):
    """property: it holds every used row once, in order, or the row of the fault is named."""
    n = len(step)
    try:
        found = grid(np.cumsum(step), np.random.default_rng(seed).random(n) < 0.5)
    except times.BadStamps as fault:
        assert 0 <= fault.row < n
        return
    placed = found.place(np.arange(n, dtype=float))
    assert len(placed) == found.size
    np.testing.assert_array_equal(placed[np.isfinite(placed)], np.arange(n)[found.rows])


def minutes(degrees, digits):
    """Write degrees as NMEA does: whole ones, minutes, and the letter of the half."""
    units = round(abs(degrees) * 60 * 10**digits)
    whole, part = divmod(units, 60 * 10**digits)
    written = f"{part // 10**digits:02d}.{part % 10**digits:0{digits}d}"
    return whole, written, units / 60 / 10**digits


@given(
    lat=st.floats(-90, 90), lon=st.floats(-180, 180),
    digits=st.integers(1, 8), height=st.integers(-400, 9000), second=st.integers(0, 86_000),
)  # fmt: skip
def test_a_position_is_read_as_a_receiver_wrote_it(tmp_path, lat, lon, digits, height, second):
    """property: everywhere on Earth, with any number of digits of a minute."""
    assume(abs(lat) > 1e-3)  # zero, zero is written where there is no fix
    (a, b, north), (c, d, east) = minutes(lat, digits), minutes(lon, digits)
    written = []
    for k in range(12):
        at = f"{clock(second + k)},{a:02d}{b},{'NS'[lat < 0]},{c:03d}{d},{'EW'[lon < 0]}"
        written.append(sentence(f"GNGGA,{at},1,09,1.0,{height + 0.5},M,40.0,M,,"))
    path = tmp_path / "drive.nmea"
    path.write_text("\r\n".join(written))
    gnss = sensorlogs.read_moving([path]).gnss
    # pynmeagps rounds degrees to ten decimals, 6 µm
    for read, degrees, written in ((gnss.lat_deg, lat, north), (gnss.lon_deg, lon, east)):
        np.testing.assert_allclose(np.abs(read), written, rtol=0, atol=6e-11)
        assert (np.sign(read) == (np.sign(degrees) if written else 0)).all()
    np.testing.assert_allclose(gnss.height_m, height + 0.5)
    np.testing.assert_allclose(np.diff(gnss.t_s), 1.0)


BODY = st.text(string.digits + string.ascii_uppercase + ",.-*$\r\n ", max_size=60)


KIND = st.sampled_from(["GGA", "GSA", "RMC", "GNS", "GLL", "VTG"])


@given(kind=KIND, bodies=st.lists(BODY, max_size=9))
def test_any_sentences_of_a_receiver_are_read_or_refused(tmp_path, kind, bodies):
    """property: fields of any length, number and content, with checksums that are right."""
    path = tmp_path / "drive.nmea"
    path.write_text("\n".join(sentence(f"GP{kind},{body}") for body in bodies))
    refusal(lambda: sensorlogs.read_moving([path]))


ADD = "atlas add model.json --product bmi088 --title a --licence CC0 --source me"


@pytest.mark.parametrize("command", ["export model.json --out out", ADD])
@given(data=st.data())
def test_a_model_that_was_edited_is_taken_or_refused(tmp_path, monkeypatch, capsys, command, data):
    """property: any value in any place of model.json; a refusal writes nothing."""
    whole = {"": broken(["source", "sha256"], "0123456789" * 6 + "abcd")}
    for channel in whole[""]["channels"]:  # B has a bound, so that the atlas takes it
        channel["parameters"]["bias_instability"]["high"] = 1.0
    part, key = whole, ""
    while isinstance(part[key], (dict, list)) and part[key] and data.draw(st.integers(0, 4)):
        part = part[key]
        keys = sorted(part) if isinstance(part, dict) else range(len(part))
        key = data.draw(st.sampled_from(keys))
    part[key] = data.draw(ANY_JSON)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(datasheets, "GIVEN", tmp_path / "out")
    (tmp_path / "model.json").write_text(json.dumps(whole[""]))
    status, said = answered(capsys, command.split())
    assert not status or said.count("\n") == 1


KEYS = st.sampled_from([*catalogue.KEYS, "rate"])


STANZA = st.dictionaries(KEYS, ANY_JSON.filter(lambda v: v is not None), max_size=4)


@given(stanza=STANZA, file=st.booleans())
def test_any_stanza_is_read_or_refused(tmp_path, monkeypatch, stanza, file):
    """property: a catalogue with values of any kind under its keys."""

    def toml(value):
        if isinstance(value, dict):
            return "{" + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(map(toml, value)) + "]"
        if isinstance(value, float):
            return repr(value)
        return json.dumps("" if value is None else value)

    (tmp_path / "my.csv").write_bytes(WHOLE)
    text = "[mine]\n" + "\n".join(f"{k} = {toml(v)}" for k, v in stanza.items() if k != "file")
    own_logs(monkeypatch, tmp_path, text + '\nfile = "my.csv"' * file)
    refusal(lambda: sensorlogs.read("mine"))


WORDS = (
    st.floats().map(repr) | st.floats(0, 50).map("{:.3g}".format) | st.text(max_size=5)
    | st.sampled_from(["deg/s", "gyro=mg", "0:10", "5:1", "5:20", "1e-300", "1,2,3", "car", "s"])
)  # fmt: skip
NEEDED = {  # by each verb, so that its other flags matter
    "report": ["my.csv", "--out", "out"], "replay": ["drive.csv", "--out", "out"],
    "plan": ["--rate", "100", "--white", "0.1"], "which-gyro": ["--error", "1"],
}  # fmt: skip


@pytest.mark.parametrize("verb", NEEDED)
@given(data=st.data())
@settings(max_examples=20)
def test_any_word_after_a_flag_is_taken_or_refused(tmp_path, monkeypatch, capsys, verb, data):
    """property: of up to two flags of a verb; refused, it says why and writes nothing."""
    options = [p for p in app.commands[verb].params if p.opts[0][0] == "-" and not p.is_flag]
    more = []
    for option in data.draw(st.lists(st.sampled_from(options), min_size=1, max_size=2)):
        words = st.sampled_from(list(getattr(option.type, "choices", ["deg/s"]))) | WORDS
        more += [option.opts[0], data.draw(words)]
    assume("--out" not in more)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.csv").write_bytes(WHOLE)
    csv_of(tmp_path, "t_s,lat,lon", [(k, 47.0, 8 + 1e-5 * k) for k in range(30)], "drive.csv")
    status, said = answered(capsys, [verb, *NEEDED[verb], *more])
    assert not status or said.strip()
