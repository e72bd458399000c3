"""Sweeps that are run: the same bytes whatever the order, the workers, the shard or a kill, and what is written."""

import csv
import hashlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from milkglass.core.errors import InputError
from milkglass.core.threads import AtOnce
from milkglass.viewer.commands.cli import main
from milkglass.viewer.files.images import read_channels, read_texts
from milkglass.viewer.render.renderer import Renderer
from milkglass.viewer.sweep import measured, sheet, work
from milkglass.viewer.sweep.pools import Pool, in_processes, on_cluster
from milkglass.viewer.sweep.run import Shard, count_missing, run
from milkglass.viewer.sweep.sweep import Sweep
from tests.support.paths import PACKAGES
from tests.support.solids import block
from tests.support.waiting import wait_until

pytestmark = pytest.mark.slow

SCENE = """
[model]
path = "block.ply"
size_mm = 20
[transport]
resolution = 24
[display]
image_size = [24, 24]
[specular]
strength = 0
"""
SWEEP = """
scene = "scene.toml"
[grid]
"material.name" = ["jade", "whole milk"]
[turntable]
frames = 3
[output]
samples = 1
files = ["png", "mask", "depth", "normal"]
animation = "gif"
"""


@pytest.fixture
def sweep(tmp_path, context):
    block((2.0, 1.0, 0.5)).export(tmp_path / "block.ply")
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    (tmp_path / "turn.toml").write_text(SWEEP, encoding="utf-8")
    return Sweep.load(tmp_path / "turn.toml")


def pictures(folder):
    """The hash of each picture's files."""
    names = [name for row in json.loads((folder / "index.json").read_text("utf-8")) for name in row["files"]]
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names}


def test_the_same_bytes_by_two_processes_by_shards_after_a_kill_and_alone(sweep, tmp_path, monkeypatch):
    assert run(sweep, tmp_path / "one") == 6
    expected = pictures(tmp_path / "one")
    assert len(expected) == 6 * 5

    for number in (2, 1):
        run(sweep, tmp_path / "shards", shard=Shard(number, 2))
    assert pictures(tmp_path / "shards") == expected

    pools = []

    @contextmanager
    def counted():
        with in_processes(2)() as pool:
            pools.append(pool)
            yield pool

    def tell(_):
        if len(pools) == 1:  # the first pool's workers, once a picture is there
            for process in multiprocessing.active_children():
                process.kill()

    run(sweep, tmp_path / "killed", counted, tell=tell)
    assert len(pools) > 1
    assert pictures(tmp_path / "killed") == expected

    for name in ("00001.png", "00004.png"):
        assert main(["render", "--scene", str(tmp_path / "one" / name), "--output", str(tmp_path / "alone.png")]) == 0
        assert (tmp_path / "alone.png").read_bytes() == (tmp_path / "one" / name).read_bytes()


def test_an_interrupt_leaves_no_process_and_no_half_written_file(sweep, tmp_path):
    def tell(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(sweep, tmp_path / "out", in_processes(2), tell=tell)
    assert multiprocessing.active_children() == []
    assert not list((tmp_path / "out").rglob(".milkglass-*"))


@contextmanager
def cluster(folder, workers):
    """A scheduler of Dask's and so many workers: its address, and the workers' processes."""
    module, address = "distributed.cli.dask_", folder / "scheduler.json"
    with ExitStack() as stack, (folder / "dask.log").open("w") as log:

        def start(program, *arguments):
            command = [
                sys.executable,
                "-m",
                module + program,
                "--scheduler-file",
                address,
                "--no-dashboard",
                *arguments,
            ]
            environment = os.environ | {"PYTHONPATH": str(PACKAGES)}
            process = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder, env=environment)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        start("scheduler", "--port", "0", "--host", "127.0.0.1")
        processes = [start("worker", "--nthreads", "1", "--no-nanny") for _ in range(workers)]
        wait_until(address.exists)
        yield json.loads(address.read_text("utf-8"))["address"], processes


def test_a_cluster_loses_a_worker_and_no_picture(sweep, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    run(sweep, tmp_path / "one")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    sweep = Sweep.load("turn.toml")  # by names that mean something else where the workers are
    with cluster(tmp_path / "elsewhere", 2) as (address, processes):
        killed = []

        def tell(_):
            if killed:
                return
            with distributed.Client(address, set_as_default=False) as client:
                busy = [name for name, work in client.processing().items() if work]
                killed.extend(client.run(os.getpid, workers=busy).values())
            for number in killed:
                os.kill(number, signal.SIGKILL)

        assert run(sweep, Path("many"), on_cluster(address), tell=tell) == 6
        assert [process.pid in killed for process in processes].count(True) == 1
    assert pictures(tmp_path / "many") == pictures(tmp_path / "one")


def test_no_scheduler_is_a_sentence(sweep, tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("milkglass.viewer.sweep.pools.ANSWER_SECONDS", 0.1)
    arguments = ["sweep", str(tmp_path / "turn.toml"), "--output", str(tmp_path / "out")]
    assert main([*arguments, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "no scheduler answers" in capsys.readouterr().err


def test_what_is_there_is_not_made_again_and_what_changed_is(sweep, tmp_path):
    folder, made = tmp_path / "out", []
    run(sweep, folder)
    run(sweep, folder, tell=made.append)
    assert made == []
    (folder / "00002_mask.png").unlink()
    (folder / ".sweep" / "0000004.row.json").write_text('{"hash": "cut sho', encoding="utf-8")
    assert count_missing(sweep, folder) == 2
    run(sweep, folder, tell=made.append)
    assert sorted(one.index for one in made) == [2, 4]

    block((2.0, 1.0, 0.6)).export(tmp_path / "block.ply")
    assert count_missing(sweep, folder) == 6
    scene = (tmp_path / "scene.toml").read_text("utf-8")
    (tmp_path / "scene.toml").write_text(scene.replace("size_mm = 20", "size_mm = 20.0"), encoding="utf-8")
    block((2.0, 1.0, 0.5)).export(tmp_path / "block.ply")
    assert count_missing(Sweep.load(tmp_path / "turn.toml"), folder) == 0


def test_indices_planes_and_cameras_say_what_each_picture_is(sweep, tmp_path):
    folder = tmp_path / "out"
    run(sweep, folder)
    with (folder / "index.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["material.name"] for row in rows] == ["jade"] * 3 + ["whole milk"] * 3
    assert [float(row["turn_deg"]) for row in rows] == [0.0, 120.0, 240.0] * 2
    assert {row["version"] for row in rows} == {read_texts(folder / "00000.png")["Software"].split()[1]}
    assert len({row["hash"] for row in rows}) == 6

    # A point of the surface, by the camera of transforms.json, is at its pixel and as deep as the plane says.
    transforms = json.loads((folder / "transforms.json").read_text("utf-8"))
    for i, frame in enumerate(transforms["frames"]):
        to_world = np.array(frame["transform_matrix"])
        scene = sweep.row(i).scene
        depth = read_channels(folder / f"{i:05d}_depth.exr")["Z"]
        steps = np.asarray(Image.open(folder / f"{i:05d}_depth.png")).astype(float)
        mask = np.asarray(Image.open(folder / f"{i:05d}_mask.png"))
        assert ((depth > 0) == (mask == 255)).all()
        near, far = float(rows[i]["depth_near_mm"]), float(rows[i]["depth_far_mm"])
        mean = near + (steps[mask > 0] - 1) / 65534 * (far - near)
        np.testing.assert_allclose(mean, depth[mask > 0], atol=1e-3)
        y, x = np.argwhere(mask == 255).mean(axis=0).round().astype(int)
        ray = np.array([(x + 0.5 - frame["cx"]) / frame["fl_x"], -(y + 0.5 - frame["cy"]) / frame["fl_y"], -1.0])
        place = to_world[:3, :3] @ (ray * depth[y, x]) + to_world[:3, 3]
        assert (np.abs(place) <= np.array([10.0, 5.0, 2.5]) + 0.02).all()  # of the block
        assert np.isclose(np.abs(place), [10.0, 5.0, 2.5], atol=0.02).any()
        assert scene.camera.target_mm == (0.0, 0.0, 0.0)
    assert len({frame["fl_x"] for frame in transforms["frames"]}) == 1  # one zoom, for the turn does not breathe

    with Image.open(folder / "turntable-00001.gif") as film:
        assert film.n_frames == 3
    with Image.open(folder / "contact_sheet.png") as sheet:
        assert sheet.width > 3 * 160


def test_a_kept_renderer_that_starts_cold_draws_as_a_new_one(sweep):
    first, second = sweep.row(0).scene, sweep.row(4).scene
    kept = Renderer()
    kept.render(first, samples=1)
    kept.start_cold()
    np.testing.assert_array_equal(
        kept.render(second, samples=1).radiance, Renderer().render(second, samples=1).radiance
    )


def test_another_sweeps_folder_is_left_alone(sweep, tmp_path, capsys):
    run(sweep, tmp_path / "out", shard=Shard(6, 6))
    (tmp_path / "other.toml").write_text('[grid]\n"model.size_mm" = [1]\n', encoding="utf-8")
    assert main(["sweep", str(tmp_path / "other.toml"), "--output", str(tmp_path / "out")]) == 2
    assert "holds pictures of another sweep (turn, over material.name, turn_deg)" in capsys.readouterr().err


def test_a_dry_run_says_how_many_and_writes_nothing(sweep, tmp_path, capsys):
    assert main(["sweep", str(tmp_path / "turn.toml"), "--output", str(tmp_path / "out"), "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith("6 pictures, 6 of them to be made: about ")
    assert not (tmp_path / "out").exists()


def test_workers_that_die_again_and_again_end_in_a_sentence(sweep, tmp_path):
    class Dying(AtOnce):
        def submit(self, work, /, *args, **kwargs):
            raise BrokenProcessPool

    with pytest.raises(InputError, match="were killed 3 times at the same picture"):
        run(sweep, tmp_path / "out", lambda: nullcontext(Pool(Dying())))


def test_a_row_whose_model_is_missing_or_damaged_is_named(sweep, tmp_path, capsys):
    (tmp_path / "damaged.ply").write_text("ply", encoding="utf-8")
    (tmp_path / "many.toml").write_text(
        'scene = "scene.toml"\ntable = "t.csv"\n[output]\nsamples = 1', encoding="utf-8"
    )
    for name in ("missing", "damaged"):
        (tmp_path / "t.csv").write_text(f"name,model.path\nfirst,\nsecond,{name}.ply\n", encoding="utf-8")
        assert main(["sweep", str(tmp_path / "many.toml"), "--output", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert said.startswith("milkglass: picture 1 (second) of the sweep: ")
        assert f"{name}.ply" in said
        assert said.count("\n") == 1
    assert (tmp_path / "out" / "00000.png").exists()  # before what is damaged was read
    assert not (tmp_path / "out" / "00001.png").exists()


def test_a_full_disk_is_a_sentence_and_the_next_run_goes_on(sweep, tmp_path, monkeypatch):
    folder, write, count = tmp_path / "out", work.ledger.write_row, []

    def full(*args):
        if len(count) == 2:
            raise InputError(f"{folder} could not be written (No space left on device)")
        count.append(write(*args))

    monkeypatch.setattr(work.ledger, "write_row", full)
    with pytest.raises(InputError, match="No space left"):
        run(sweep, folder)
    monkeypatch.undo()
    assert run(sweep, folder) == 4


def test_more_than_a_million_pictures_are_asked_for_twice(tmp_path, capsys):
    (tmp_path / "many.toml").write_text("[random]\ncount = 1000001\nmodel.size_mm = {low=1,high=2}", encoding="utf-8")
    assert main(["sweep", str(tmp_path / "many.toml"), "--output", str(tmp_path / "out")]) == 2
    assert "has 1,000,001 pictures; add --yes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("method", "expected"), [("diffusion", (0.3, 0.02, "photons")), ("ewald", (0.05, 0.0, "equation (1)"))]
)
def test_the_measured_error_is_that_of_the_report_in_the_worst_channel(sweep, tmp_path, monkeypatch, method, expected):
    by_photons = {"by": "photons", "whole": {"rms": [0.1, None, 0.3], "noise": [0.01, None, 0.02]}}
    by_equation = SimpleNamespace(deviation=SimpleNamespace(rms=(0.01, 0.05, 0.02)))
    monkeypatch.setattr(measured, "transport_content", lambda *_: by_photons)
    monkeypatch.setattr(measured, "error_report", lambda *_, **__: by_equation)
    many = f'scene = "scene.toml"\n[grid]\n"transport.method" = ["{method}"]\n[output]\nmeasured = true\nsamples = 1\n'
    (tmp_path / "many.toml").write_text(many, encoding="utf-8")
    run(Sweep.load(tmp_path / "many.toml"), tmp_path / "out")
    (row,) = json.loads((tmp_path / "out" / "index.json").read_text("utf-8"))
    assert (row["measured_error"], row["measured_noise"], row["measured_by"]) == expected
    with (tmp_path / "out" / "index.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["measured_by"] == expected[-1]


def test_where_no_error_can_be_measured_the_note_says_why(sweep, tmp_path):
    varied = '[grid]\n"display.background" = ["#ffffff"]\nlights = [[]]\n[output]\nsamples = 1\nmeasured = true\n'
    (tmp_path / "many.toml").write_text(f'scene = "scene.toml"\n{varied}', encoding="utf-8")
    run(Sweep.load(tmp_path / "many.toml"), tmp_path / "out")
    (row,) = json.loads((tmp_path / "out" / "index.json").read_text("utf-8"))
    assert "The error was not measured: " in row["note"]
    assert "measured_error" not in row


def test_films_have_even_sides_and_every_pixel_as_it_is(tmp_path, monkeypatch):
    """H.264 takes no others; the encoder would resize them, and say so to nobody."""
    sent, asked = [], []

    def write_frames(path, size, *, macro_block_size, **_):
        asked.append((size, macro_block_size))
        Path(path).touch()
        while True:
            sent.append((yield))

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", SimpleNamespace(write_frames=write_frames))
    pixels = np.random.default_rng(0).integers(0, 255, (5, 7, 3), np.uint8)
    for i in range(2):
        Image.fromarray(pixels + np.uint8(i)).save(tmp_path / f"{i}.png")
    rows = [{"index": i, "files": [f"{i}.png"]} for i in range(2)]
    (film,) = sheet.write_films(tmp_path, rows, 2, "mp4", 10.0)
    assert film.exists()
    assert asked == [((8, 6), 1)]
    for i, frame in enumerate(sent):
        np.testing.assert_array_equal(np.frombuffer(frame, np.uint8).reshape(6, 8, 3)[:5, :7], pixels + np.uint8(i))


@pytest.mark.parametrize("text", ["0/2", "3/2", "a/2", "2", "1/"])
def test_a_wrong_shard_is_a_sentence(text):
    with pytest.raises(InputError, match="write I/N such as 2/8"):
        Shard.parse(text)
