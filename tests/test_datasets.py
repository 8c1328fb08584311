"""The registry of raw logs: where a file is found, that it is checked, how it is refused."""

import shutil
from unittest.mock import Mock

import numpy as np
import pooch
import pytest
import rdata
from refused import refused

from analysis import DATA, CannotAnswer, WrongUsage
from sensorlogs import catalogue, datasets, read
from sensorlogs.catalogue import load_catalogue

NAME = "gpsd-logs/rx210.log"
AWAY = "phone-drives/LICENSE"


@pytest.fixture(autouse=True)
def nowhere(tmp_path, monkeypatch):
    """Point the folders of raw logs at empty ones."""
    monkeypatch.delenv(datasets.FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(datasets, "DOWNLOADED", tmp_path / "downloaded")


def test_committed_raw_logs_are_the_registered_ones():
    """Cross-check: what is committed equals the registry, byte for byte, and nothing else is."""
    committed = {p.name for p in (DATA / "raw" / "gpsd").iterdir()}
    registered = datasets.names("gpsd-logs")
    assert committed == {name.split("/")[1] for name in registered}
    for name in registered:
        assert datasets.path(name).parent == DATA / "raw" / "gpsd"
    assert [p.name for p in (DATA / "raw").iterdir()] == ["gpsd"]


def test_the_folder_variable_comes_first_and_other_bytes_are_refused(tmp_path, monkeypatch):
    """Property: it wins over what is committed; a byte changed after a first look is found."""
    (copy := tmp_path / NAME).parent.mkdir()
    shutil.copy(datasets.path(NAME), copy)
    monkeypatch.setenv(datasets.FOLDER_VARIABLE, str(tmp_path))
    assert datasets.available(NAME) and datasets.path(NAME) == copy
    copy.write_bytes(copy.read_bytes()[:-1] + b"?")
    assert not datasets.available(NAME)
    refused(CannotAnswer, r"gpsd-logs/rx210\.log .*not the registered file", datasets.path, NAME)


RAW = "adis16405-static/adis_16405_imu1.rda"


@pytest.mark.parametrize(("ask", "name", "file"), [
    (datasets.path, AWAY, AWAY), (read, "adis16405", RAW)])  # fmt: skip
def test_an_absent_file_says_the_three_ways_to_get_it(ask, name, file):
    """Property: one sentence with the variable, the command and the address; a stanza's too."""
    assert not datasets.available(file)
    said = str(refused(datasets.NotHere, None, ask, name))
    for word in (file, "COMPENDIUM_DATA", f"python -m analysis data {file}", "data/downloaded"):
        assert word in said


def test_names_and_unknown_names():
    """Property: a folder, a pattern or a file; what is not registered is wrong usage."""
    assert datasets.names("mpu6050-static") == datasets.names("mpu6050-static/*")
    assert datasets.names(NAME) == [NAME]
    for call in (datasets.names, datasets.dataset):
        refused(WrongUsage, r"nothing\.log", call, "nothing.log")


def test_addresses_name_a_commit():
    """Property: every file outside a source package has an address that cannot change."""
    for entry in datasets.registry().values():
        assert len(entry.sha256) == 64 or (not entry.sha256 and entry.commit)
        if entry.commit:
            assert entry.url.startswith(f"https://github.com/{entry.repository}/raw/")
            assert entry.commit in entry.url and " " not in entry.url


def test_a_download_is_checked_and_kept(monkeypatch):
    """Property: the right bytes land in data/downloaded/, wrong ones are refused."""
    content = (DATA / "raw" / "gpsd" / "rx210.log").read_bytes()
    monkeypatch.setattr(datasets, "COMMITTED", {})

    def retrieve(url, known_hash, fname, path, downloader):
        path.mkdir(parents=True)
        (path / fname).write_bytes(content)

    monkeypatch.setattr(pooch, "retrieve", retrieve)
    assert datasets.fetch(NAME) == datasets.DOWNLOADED / NAME
    assert datasets.path(NAME).read_bytes() == content


def test_a_large_set_keeps_the_sha256_of_its_first_use(tmp_path, monkeypatch):
    """Property: a part of it is refused, its bytes are kept in mind, others refused after that."""
    name = load_catalogue()["bmi055"]["file"]
    (file := tmp_path / name).parent.mkdir()
    rdata.write_rda(file, {"BMI055": np.random.default_rng(1).standard_normal((300, 6))})
    monkeypatch.setenv(datasets.FOLDER_VARIABLE, str(tmp_path))
    assert not datasets.dataset(name).sha256
    refused(CannotAnswer, "300 rows, .* source states 4194305", read, "bmi055", unit="rad/s")
    assert datasets.dataset(name).sha256 == datasets.sha256(file)
    whole = file.read_bytes()
    file.write_bytes(whole[:-1])
    refused(CannotAnswer, "first use .*downloaded/synimu/BMI055", read, "bmi055", unit="rad/s")
    file.write_bytes(whole)
    few = load_catalogue()["bmi055"] | {"rows": 300}
    monkeypatch.setattr(catalogue, "load_catalogue", lambda: {"few": few})
    assert read("few", unit="rad/s").samples == 300
    rdata.write_rda(file, {"gyro": np.sin(np.arange(300.0))})  # a vector
    assert read(file, columns=["c1"], unit="rad/s", rate=100).samples == 300


@pytest.mark.parametrize(("error", "words"), [
    (ConnectionError("no route"), "check the connection"), (ValueError("hash"), "sha256")
])  # fmt: skip
def test_a_failed_download_is_one_sentence(monkeypatch, error, words):
    """Property: no connection, or other bytes: said plainly, and nothing is left behind."""
    monkeypatch.setattr(pooch, "retrieve", Mock(side_effect=error))
    refused(CannotAnswer, words, datasets.fetch, AWAY)
    assert not datasets.DOWNLOADED.exists()
