"""Files of every kind, damaged by a seeded generator: each is read or refused in one sentence, and nothing else.

Bytes are changed, cut out, doubled, cut off, or replaced by words that readers stumble over. Whatever numbers a file
then claims, reading must not take memory by them.
"""

import resource

import numpy as np
import pytest
import trimesh

from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.viewer.assets import ray_cache
from milkglass.viewer.assets.ray_cache import RayCache
from milkglass.viewer.files import depth, images
from milkglass.viewer.files.model import read_model
from milkglass.viewer.files.radiance import read_radiance
from milkglass.viewer.gui.events import Drawn, MouseMoved, Recorder, Resized, read_recording
from milkglass.viewer.scene import own_materials
from milkglass.viewer.scene.scene import Scene
from milkglass.viewer.scene.tables import read_profile_table
from milkglass.viewer.session.preferences import Preferences

CASES = 200  # of each kind
MOST_BYTES = 2 << 30  # that reading may add to the largest resident memory of the process
WORDS = [b"nan", b"-1", b"1e999", b"99999999999", b"\xff\xfe", b"\0\0\0\0", b"[[[[", b'"', b"\n", b"{}", b"f 1 2", b"0"]


def damaged(content, rng):
    """Return bytes with one to four faults in them."""
    content = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        at, length = int(rng.integers(0, len(content) + 1)), int(rng.integers(1, 9))
        # Heads say how much is to come.
        at = at if rng.random() < 0.5 else at % 200
        fault = rng.integers(0, 6)
        if fault == 0:
            content[at : at + length] = rng.integers(0, 256, length, np.uint8).tobytes()
        elif fault == 1:
            del content[at : at + length]
        elif fault == 2:
            content[at:at] = content[at : at + length]
        elif fault == 3:
            del content[at:]
        elif fault == 4:
            content[at : at + length] = WORDS[int(rng.integers(len(WORDS)))]
        elif at < len(content):
            content[at] ^= 1 << int(rng.integers(8))
    return bytes(content)


def model(suffix, **options):
    def write(path):
        trimesh.creation.box((1, 2, 3)).export(path, file_type=suffix, **options)

    return f".{suffix}", write, lambda path: read_model(path, 100.0)


def write_obj(path):
    corners = "".join(f"v {x} {y} {z}\nvt {x} {y}\nvn 0 0 1\n" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    path.write_text(
        f"# a box\nmtllib no.mtl\no box\nusemtl a\n{corners}f 1/1/1 2/2/2 4/4/4 3/3/3\nf 1 5 6 2\nf 7/7 8/8 6/6\n"
    )


def write_gltf(path):
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box((1, 2, 3))), embed_buffers=True)
    path.write_bytes(next(content for name, content in files.items() if name.endswith(".gltf")))


def write_recording(path):
    recorder = Recorder(path, Scene().to_toml())
    for event in (Resized((640, 480), (640, 480)), MouseMoved(3.0, 4.0), Drawn(0.1)):
        recorder.add(event)
    recorder.close()


def write_table(path):
    path.write_text(
        "# radius_mm, R, G, B\n" + "".join(f"{r}, {0.01 / (1 + r) ** 3}, {0.02 / (1 + r) ** 4}, 0\n" for r in range(9))
    )


def write_materials(path):
    path.write_text("[candle]\nsigma_s_prime = [0.6, 0.7, 0.85]\nsigma_a = [0.0008, 0.003, 0.012]\neta = 1.44\n")


def radiance():
    return np.random.default_rng(3).random((5, 7, 3), np.float32)


def write_probe(path):
    images.write_exr(path, {name: np.ascontiguousarray(radiance()[..., i]) for i, name in enumerate("RGB")})


def write_hdr(path):
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1\n\n-Y 5 +X 7\n"
    path.write_bytes(head + np.random.default_rng(3).integers(1, 200, (35, 4), np.uint8).tobytes())


def write_png(path):
    images.write_png(path, (radiance() * 255).astype(np.uint8))


KINDS = {
    "ply": model("ply"),
    "ascii ply": model("ply", encoding="ascii"),
    "stl": model("stl"),
    "ascii stl": (".stl", lambda path: trimesh.creation.box().export(path, file_type="stl_ascii"), model("stl")[2]),
    "off": model("off"),
    "glb": model("glb"),
    "gltf": (".gltf", write_gltf, model("gltf")[2]),
    "obj": (".obj", write_obj, model("obj")[2]),
    "exr": (".exr", write_probe, read_radiance),
    "hdr": (".hdr", write_hdr, read_radiance),
    "png": (".png", write_png, images.read_photo),
    "npy": (
        ".npy",
        lambda path: np.save(path, radiance()[..., 0]),
        lambda path: depth.depth_format_of(path).read(path),
    ),
    "scene": (".toml", lambda path: Scene().save(path), Scene.load),
    "materials": (".toml", write_materials, own_materials.read),
    "profile": (".csv", write_table, read_profile_table),
    "recording": (".jsonl", write_recording, read_recording),
    "preferences": (".json", lambda path: Preferences((800, 600), "/", ["/a.ply"]).save(path), Preferences.load),
}


def refusal(read, path):
    """Return the one line with which a file is refused, None where it is read."""
    try:
        read(path)
    except InputError as error:
        return "two lines" if "\n" in str(error) else str(error)
    return None


def peak_bytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(kind, tmp_path, capfd):
    suffix, write, read = KINDS[kind]
    path = tmp_path / f"sound{suffix}"
    write(path)
    read(path)
    sound, before, refused = path.read_bytes(), peak_bytes(), 0
    rng = np.random.default_rng(len(kind))
    for i in range(CASES):
        path = tmp_path / f"damaged{i}{suffix}"
        path.write_bytes(damaged(sound, rng))
        sentence = refusal(read, path)
        assert sentence is None or path.name in sentence, f"case {i}: {sentence}"
        refused += sentence is not None
    assert peak_bytes() - before < MOST_BYTES
    assert refused > 0 or kind == "preferences"
    assert capfd.readouterr() == ("", "")


def test_a_damaged_cache_is_none(tmp_path, monkeypatch):
    monkeypatch.setattr(ray_cache, "cache_folder", lambda: tmp_path)
    box, cache, rng = trimesh.creation.box(), RayCache("rays", 1), np.random.default_rng(4)
    mesh = Mesh.of(box.vertices.astype(np.float32), box.vertex_normals.astype(np.float32), box.faces.astype(np.int32))
    kept = {"bits": rng.integers(0, 256, (8, 40), np.uint8)}
    cache.keep(mesh, kept)
    sound = cache.path(mesh).read_bytes()
    for i in range(2 * CASES):
        cache.path(mesh).write_bytes(damaged(sound, rng))
        found = cache.read(mesh, {"bits": np.uint8})
        assert found is None or np.array_equal(found["bits"], kept["bits"]), f"case {i}"


def test_the_cache_of_another_mesh_is_none(tmp_path, monkeypatch):
    monkeypatch.setattr(ray_cache, "cache_folder", lambda: tmp_path)
    cache, meshes = RayCache("rays", 1), []
    for size in (1.0, 2.0):
        box = trimesh.creation.box((size, 1.0, 1.0))
        vertices, normals = (array.astype(np.float32) for array in (box.vertices, box.vertex_normals))
        meshes.append(Mesh.of(vertices, normals, box.faces.astype(np.int32)))
        cache.keep(meshes[-1], {"bits": np.full((8, 4), size, np.uint8)})
    cache.path(meshes[0]).replace(cache.path(meshes[1]))
    assert cache.read(meshes[1], {"bits": np.uint8}) is None
