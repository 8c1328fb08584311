"""What CONTRIBUTING.md tells: each thing added in a temporary copy, rightly and wrongly."""

import re
import shlex
import sys
import tomllib

import pandas as pd
import pytest
from refused import csv_of, own_logs, refused
from test_published import CLAIMS, claim_faults

import sensorlogs as logs
from analysis import DATA, ROOT, WrongUsage, claims, datasheets
from workbench import cli

PAGE = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
SENSOR, LOG = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)


def test_what_the_page_names_is_there():
    """property: every file, module, make target and command of the page exists."""
    named = set(re.findall(r"`((?:analysis|tests|data|notebooks|figures)/[\w./-]*)`", PAGE))
    named = {n for n in named if not re.search("35-my|data/own/|lib/", n)}
    assert len(named) > 15 and [n for n in sorted(named) if not (ROOT / n).exists()] == []
    assert {"operations", "derived"} <= {m for m, _ in re.findall(r"`(\w+)\.(\w+)`", PAGE)}
    rules = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    assert set(re.findall(r"`make ([a-z-]+)`", PAGE)) <= rules
    assert set(re.findall(r"python -m analysis ([a-z]+)", PAGE)) <= set(cli.app.commands)


def test_a_sensor(tmp_path):
    """property: the page's stanza joins the sheets; a line that lacks or is wrong is named."""
    path, before = tmp_path / "sensors.toml", (DATA / "sensors.toml").read_text("utf-8")
    path.write_text(before + SENSOR, "utf-8")
    assert datasheets.read(path)["my-gyro"] == tomllib.loads(SENSOR)["my-gyro"]
    for line, words in (("source", "source"), ("density_deg_s", "arw_deg_sqrt_h or")):
        path.write_text(before + re.sub(f"^{line}.*", "", SENSOR, flags=re.MULTILINE), "utf-8")
        said = rf"sensors\.toml: \[my-gyro\] needs one line {words}"
        refused(WrongUsage, said, datasheets.read, path)
    wrong = {"price_usd": "[20, 5];[5];5;['5', '20'];[0, 5];[5, inf]"}
    wrong |= {"density_deg_s": "0;-1;'1';true;nan"}
    for field, value in ((f, v) for f, of in wrong.items() for v in of.split(";")):
        path.write_text(before + re.sub(f"{field} = .*", f"{field} = {value}", SENSOR), "utf-8")
        said = rf"sensors\.toml: \[my-gyro\] {field} = .*, not {re.escape(value)}"
        refused(WrongUsage, f"(?i){said}", datasheets.read, path)


def test_a_log(tmp_path, monkeypatch):
    """property: the page's stanza is read by its name; a key that is none is named."""
    own_logs(monkeypatch, tmp_path, LOG)
    csv_of(tmp_path, "t_s,gx", ((t, f"{t % 3 / 7:.4f}") for t in range(900)))
    log = logs.read("my-log")
    assert (log.channels[0].name, log.channels[0].unit, log.samples) == ("gyro_x", "deg/s", 300)
    own_logs(monkeypatch, tmp_path, LOG.replace("from =", "begin ="))
    refused(WrongUsage, "begin", logs.read, "my-log")


ROW = CLAIMS.iloc[0].to_dict() | {
    "id": "terrain-my-claim", "paper": "terrain", "where": "Fig 99", "claim": "Twice the noise.",
    "quantity": "error at 2 N over that at N", "value": "2", "unit": "times", "low": "1.5",
    "high": "2.5", "why": "'twice' read as within a quarter; fails if the noise is not the cause",
    "notebook": "22-sensor-sweeps",
}  # fmt: skip


def test_a_claim(tmp_path, monkeypatch):
    """property: a new row has no fault, and its verdict, in words."""
    assert claim_faults(ROW) == []
    (tmp_path / "published").mkdir()
    register = CLAIMS.reset_index(drop=True)
    register.loc[len(register)] = ROW
    register.to_csv(tmp_path / "published" / "claims.csv", index=False)
    monkeypatch.setattr(claims, "DATA", tmp_path)
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(tmp_path))
    assert claims.Ledger("99-test").check(ROW["id"], 1.8, 1.6, 2.0) == "reproduced"
    assert claims.verdicts().loc[ROW["id"], "reproduced"] == "× 1.8 (× 1.6 to 2)"


def test_an_estimator(tmp_path, monkeypatch):
    """property: the page's script, entered by the page's command, gives N and nothing else."""
    pytest.importorskip("allan_variance")
    monkeypatch.chdir(tmp_path)
    script, command = re.findall(r"```(?:python|sh)\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "mine.py").write_text(script)
    words = command.replace("'python ", f"'{sys.executable} ").replace("--runs 3", "--runs 1")
    assert cli.main([*shlex.split(words)[3:], "--workers", "1"]) == 0
    rows = pd.read_csv("try/walk-2h.csv").set_index(["method", "parameter"]).loc["mine"]
    arw = rows.loc["arw", ["given", "held", "width"]].astype(float)
    assert arw.round(2).to_list() == [1, 1, 0.02]
    assert (rows["given"].drop("arw") == 0).all()
