import pytest

from milkglass.core.material import library as materials
from milkglass.viewer.commands import cli


def test_materials_in_a_pipe_are_one_whole_line_each(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    assert cli.main(["materials"]) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert header.split()[:3] == ["name", "source", "eta"]
    assert len(lines) == 50
    for line, material in zip(lines, materials.library(), strict=True):
        assert line.startswith(material.name)
        assert "; ".join(materials.validity_notes(material)) in line
        assert "…" not in line
    jade = next(line for line in lines if line.startswith("jade"))
    assert "1.2 1.1 1.2" in jade
    assert "#a5d0b1" in jade


def test_one_material_channel_by_channel(capsys):
    assert cli.main(["materials", "skim milk"]) == 0
    out = capsys.readouterr().out
    rows = {line[:27].strip(): line[27:].split() for line in out.splitlines()[:8]}
    assert rows["reduced scattering sigma_s'"] == ["0.7", "1.22", "1.9", "1/mm"]
    assert rows["diffuse reflectance R_d"] == ["0.81495", "0.81298", "0.6823"]
    assert float(rows["mean free path 1/sigma_t'"][0]) == pytest.approx(1 / 0.7014, abs=1e-4)


@pytest.mark.parametrize("columns", [40, 80, 130, 400])
def test_materials_on_a_terminal_are_not_cut(columns, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", str(columns))
    assert cli.main(["materials"]) == 0
    out = capsys.readouterr().out
    assert "…" not in out
    for material in materials.library():
        assert f"{material.sigma_s_prime[2]:.3g}" in out
        assert all(word in out for word in material.name.split())
