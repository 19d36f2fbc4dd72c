"""What `bench contact` measures, on one small scene."""

import json

import numpy as np
import pytest

from pipelines import bench_contact
from pipelines.bench_contact import ContactBenchSettings, compare_openness, variations
from pipelines.errors import UsageError


def test_what_is_compared():
    rays = np.linspace(0.2, 1.0, 200)
    row = compare_openness(rays - 0.05, rays)
    assert row["rms"] == pytest.approx(0.05)
    assert row["bias"] == pytest.approx(-0.05)
    assert compare_openness(rays, rays)["best_power"] == pytest.approx(1.0)
    assert compare_openness(rays**2, rays)["best_power"] == pytest.approx(0.5)


def test_each_setting_is_changed_alone():
    (_, defaults), *others = variations()
    for name, contact in others:
        changed = [field for field in vars(contact) if getattr(contact, field) != getattr(defaults, field)]
        assert len(changed) == 1, name


def test_a_set_wants_its_scene(tmp_path, bundled_assets):
    settings = ContactBenchSettings((), tmp_path / "out", bundled_assets / "cornell.npz")
    with pytest.raises(UsageError, match="name that scene"):
        bench_contact.check(settings)


def test_rows_are_written(gpu, tmp_path, bundled_assets, monkeypatch):
    monkeypatch.setattr(bench_contact, "VARIATIONS", {"steps": (2,)})
    settings = ContactBenchSettings(
        (bundled_assets / "two_rooms.glb",), tmp_path / "out", size=(48, 32), samples=32, frames=6
    )
    report = bench_contact.run(settings, lambda text, share: None)
    rows = json.loads((tmp_path / "out" / "report.json").read_text())["rows"]
    assert [row["changed"] for row in rows] == ["defaults", "steps 2", "as printed"]
    assert rows == json.loads(json.dumps(report["rows"]))
    assert all(0 < row["rms"] < row["deviation"] for row in rows[:1])
