"""Paths through an object by Mitsuba 3, scattered light apart by whether it has met the object again.

Media are homogeneous and scatter isotropically with the reduced coefficients, behind smooth dielectric boundaries of
flat faces. Where they overlap one is there, as `core.paths.surface.Surface` has it. A path is drawn for one of R, G and
B, counts for all, and ends where it is absorbed or leaves: no roulette has to end it. Lamps are discs of even radiance
far away, seen where a path leaves in their direction.

A vectorised variant of Mitsuba takes an LLVM that is new enough: an older one aborts the process, so that `variant`
tries it in a child. Without one, `scalar_rgb` has Mitsuba's own integrator, which tells no light apart and knows one
medium.
"""

import functools
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from milkglass.core.arrays import Array
from milkglass.core.errors import InputError
from milkglass.core.geometry.mesh import Mesh
from milkglass.core.light.maps import Radiance
from milkglass.core.material.library import Material
from milkglass.core.paths.surface import Surface

VECTORISED, SCALAR = "llvm_ad_rgb", "scalar_rgb"
TRIAL_SECONDS = 120.0  # for a first kernel, which is compiled
PATHS_AT_A_TIME = 1 << 22  # what they take is in memory at once
LAMP_DISTANCE = 50.0  # of a disc in `scalar_rgb`, in radii of the object
SMALLEST = 1e-30  # sum of densities to divide by
MOST_BOUNCES = 1 << 30  # above any path


@dataclass(frozen=True, eq=False)
class Lamp:
    """A disc far away: unit direction towards its centre, (3,), radiance, (3,), and half of its angular diameter."""

    towards: Array
    radiance: Array
    half_angle: float


@dataclass(frozen=True, eq=False)
class Surrounding:
    """Light from all around: lat-long radiance (h, 2h, 3), row 0 at +y, of a map turned about +y by an angle."""

    radiance: Radiance
    rotation_deg: float


@dataclass(frozen=True, eq=False)
class View:
    """A perspective camera.

    `eye` (3,) is in mm, `rotation` (3, 3) has the columns right, up and back, `half_tangent` is of half the vertical
    angle, `size` is (width, height).
    """

    eye: Array
    rotation: Array
    half_tangent: float
    size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Subject:
    """What is traced: closed bodies, a material for each of the surface's media, their lights and the view of them."""

    surface: Surface
    materials: Sequence[Material]
    lamps: Sequence[Lamp]
    surrounding: Surrounding | None
    view: View

    @property
    def radius(self) -> float:
        """Return the largest distance of the surface from the origin, mm."""
        return float(np.linalg.norm(self.surface.faces.vertices, axis=1).max())


@dataclass(frozen=True, eq=False)
class TracedLight:
    """Radiance of light that scattered in the object, (h, w, 3) float64.

    Attributes
    ----------
    first : (h, w, 3)
        Of light that has not met the object again; with `again` None, of all of it.
    again : (h, w, 3) or None
        Of light that has left, or was mirrored, and met the object again.
    """

    first: Array
    again: Array | None

    @property
    def whole(self) -> Array:
        """All scattered light."""
        return self.first if self.again is None else self.first + self.again


@functools.cache
def variant() -> str:
    """Return the fastest variant of Mitsuba that draws here."""
    trial = f"from {__name__} import draw_trial; draw_trial()"
    try:
        done = subprocess.run([sys.executable, "-c", trial], capture_output=True, timeout=TRIAL_SECONDS)
    except subprocess.TimeoutExpired:
        return SCALAR
    return VECTORISED if done.returncode == 0 else SCALAR


def draw_trial() -> None:
    """Draw a tetrahedron with the vectorised variant: ends the process where LLVM cannot."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
    mesh = Mesh.of(corners, corners / np.sqrt(3.0), np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    view = View(np.array([0.0, 0.0, 8.0]), np.eye(3), 0.3, (4, 4))
    lamp = Lamp(np.array([0.0, 0.0, 1.0]), np.ones(3), 1.0)
    material = Material("trial", (1.0,) * 3, (0.1,) * 3, 1.3)
    traced = _vectorised(Subject(Surface.of(mesh, material.eta), [material], [lamp], None, view), 16, 0)
    if not traced.whole.any():
        raise SystemExit(1)


def trace(subject: Subject, paths: int, seed: int) -> TracedLight:
    """Return the scattered light of a subject by `paths` paths a pixel.

    Raises
    ------
    InputError
        For several media without the vectorised variant.
    """
    if variant() == VECTORISED:
        return _vectorised(subject, paths, seed)
    if len(subject.materials) > 1:
        raise InputError(
            "--path-traced knows parts with a material of their own by Mitsuba's llvm_ad_rgb, which needs an LLVM of "
            "version 16 or later; name one by DRJIT_LIBLLVM_PATH"
        )
    return _scalar(subject, paths, seed)


# Vectorised


def _vectorised(subject: Subject, paths: int, seed: int) -> TracedLight:
    import mitsuba as mi

    mi.set_variant(VECTORISED)
    scene = mi.load_dict({"type": "scene", "object": _object(mi, subject, {}), **_surroundings(mi, subject)})
    sensor = mi.load_dict(_sensor(mi, subject))
    integrator = _integrator(subject)
    width, height = subject.view.size
    most = max(1, PATHS_AT_A_TIME // (width * height))
    sums, done = np.zeros((height, width, 6)), 0
    while done < paths:
        count = min(most, paths - done)
        image = integrator.render(scene, sensor, seed=(seed << 16) + done // most, spp=count)
        sums += count * np.asarray(image, np.float64)[..., -6:]
        done += count
    return TracedLight(sums[..., :3] / paths, sums[..., 3:] / paths)


def _integrator(subject: Subject) -> Any:
    """Return an integrator whose last six channels are those of `TracedLight`."""
    import drjit as dr
    import mitsuba as mi

    lamps, faces = subject.lamps, subject.surface.faces
    medium_of_face = mi.UInt32(faces.media[faces.bodies].astype(np.uint32))
    # Of air, then of each medium.
    indices = mi.Float([1.0, *(material.eta for material in subject.materials)])
    all_albedos = np.stack([np.zeros(3), *(material.alpha_prime for material in subject.materials)])
    all_extinctions = np.stack([np.zeros(3), *(material.sigma_t_prime for material in subject.materials)])
    of_albedo, of_extinction = ([mi.Float(row.tolist()) for row in table.T] for table in (all_albedos, all_extinctions))

    def medium_of(within: Any) -> Any:
        """Return the number of the medium of a set of media, the highest one; 0 of air."""
        return 32 - dr.lzcnt(within)

    def looked_up(table: Sequence[Any], medium: Any) -> Any:
        return mi.Color3f(*(dr.gather(mi.Float, channel, medium) for channel in table))

    class Reentry(mi.SamplingIntegrator):  # type: ignore[misc]
        def aov_names(self) -> list[str]:
            return [f"{name}.{channel}" for name in ("first", "again") for channel in "RGB"]

        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:  # noqa: FBT002
            # Paths are of one channel, and count for all by the balance heuristic: with the share that each channel's
            # density has of their sum, which is `shares`.
            drawn = 3.0 * sampler.next_1d()

            def of_drawn(rgb: Any) -> Any:
                return dr.select(drawn < 1.0, rgb.x, dr.select(drawn < 2.0, rgb.y, rgb.z))

            def fly(*state: Any) -> tuple[Any, ...]:
                """Go on to the next scattering, or to the boundary, or out of the scene."""
                sampler, ray, active, shares, within, untouched, scattered, again, mirrored, left = state
                medium = medium_of(within)
                albedos, extinctions = looked_up(of_albedo, medium), looked_up(of_extinction, medium)
                sigma = of_drawn(extinctions)
                flight = dr.select(sigma > 0.0, -dr.log(1.0 - sampler.next_1d()) / sigma, dr.largest(mi.Float))
                ray.maxt = flight
                si = scene.ray_intersect(ray, active)
                hit = active & si.is_valid()
                scatters = active & (sigma > 0.0) & ~hit
                # What it meets tells on which side of it the path has been.
                facing = dr.dot(ray.d, si.n)
                bit = mi.UInt32(1) << dr.gather(mi.UInt32, medium_of_face, si.prim_index, hit)
                arriving = dr.select(facing > 0.0, within | bit, within & ~bit)
                near, far = medium_of(arriving), medium_of(arriving ^ bit)
                meets = hit & (near != far)
                eta = dr.gather(mi.Float, indices, far) / dr.gather(mi.Float, indices, near)
                share, inner, _, _ = mi.fresnel(dr.abs(facing), eta)
                reflected = meets & (sampler.next_1d() < share)
                normal = dr.select(facing > 0.0, -si.n, si.n)
                mirror = ray.d + 2.0 * dr.abs(facing) * normal
                bent = dr.normalize(ray.d / eta + (dr.abs(facing) / eta - dr.abs(inner)) * normal)
                turned = dr.select(reflected, mirror, dr.select(meets, bent, ray.d))
                left = left | (active & (within == 0) & ~hit)
                again = again | (meets & (near == 0) & scattered)
                mirrored = mirrored | (reflected & untouched)
                scattered = scattered | scatters
                alive = hit | (scatters & (sampler.next_1d() < of_drawn(albedos)))
                isotropic = mi.warp.square_to_uniform_sphere(sampler.next_2d())
                direction = dr.select(hit, turned, dr.select(scatters, isotropic, ray.d))
                passed = dr.exp(-extinctions * dr.select(hit, si.t, flight))
                density = dr.select(scatters, passed * extinctions * albedos, dr.select(hit, passed, 1.0))
                shares = shares * density
                onwards = si.spawn_ray(direction)
                onwards.o = dr.select(hit, onwards.o, ray.o + flight * ray.d)
                within = dr.select(hit, dr.select(reflected, arriving, arriving ^ bit), within)
                flags = within, untouched & ~meets, scattered, again, mirrored, left
                return sampler, onwards, active & alive, shares / dr.maximum(dr.sum(shares), SMALLEST), *flags

            flags = [mi.Bool(value) for value in (True, False, False, False, False)]
            start = sampler, mi.Ray3f(ray), mi.Bool(active), mi.Color3f(1.0 / 3.0), mi.UInt32(0), *flags
            end = dr.while_loop(start, lambda _sampler, _ray, active, *_rest: active, fly, label="paths")
            ray, shares, (scattered, again, mirrored, left) = end[1], end[3], end[6:]
            radiance = dr.zeros(mi.Color3f)
            if scene.environment() is not None:
                outside = dr.zeros(mi.SurfaceInteraction3f)
                outside.wi = -ray.d
                radiance += scene.environment().eval(outside, left)
            for lamp in lamps:
                seen = dr.dot(ray.d, mi.Vector3f(*lamp.towards.tolist())) > float(np.cos(lamp.half_angle))
                radiance += dr.select(seen, mi.Color3f(*lamp.radiance.tolist()), 0.0)
            counted = left & scattered & ~mirrored
            split = [
                dr.select(counted & (again == side), 3.0 * shares[i] * radiance[i], 0.0)
                for side in (False, True)
                for i in range(3)
            ]
            return dr.zeros(mi.Color3f), counted, split

    return Reentry(mi.Properties())


# Scalar


def _scalar(subject: Subject, paths: int, seed: int) -> TracedLight:
    """Trace with Mitsuba's own integrator; what never scatters is traced alone and taken off."""
    import mitsuba as mi

    mi.set_variant(SCALAR)
    (material,) = subject.materials
    images = []
    for albedo in (material.alpha_prime, np.zeros(3)):
        scene = {
            "type": "scene",
            "integrator": {
                "type": "volpathmis",
                "max_depth": -1,
                "rr_depth": MOST_BOUNCES,
                "hide_emitters": True,
            },
            "sensor": _sensor(mi, subject),
            "object": _object(mi, subject, _medium(material, albedo)),
            **{f"lamp {i}": _disc(mi, lamp, subject.radius) for i, lamp in enumerate(subject.lamps)},
            **_surroundings(mi, subject),
        }
        image = mi.render(mi.load_dict(scene), spp=max(paths, 1), seed=seed)
        images.append(np.asarray(image, np.float64)[..., :3])
    return TracedLight(images[0] - images[1], None)


def _medium(material: Material, albedo: Array) -> dict[str, Any]:
    sigma_t = material.sigma_t_prime
    scale = float(sigma_t.max()) or 1.0  # colours are not above 1
    colours = {"albedo": albedo, "sigma_t": sigma_t / scale}
    values = {name: {"type": "rgb", "value": value.tolist()} for name, value in colours.items()}
    return {"interior": {"type": "homogeneous", "phase": {"type": "isotropic"}, "scale": scale, **values}}


def _disc(mi: Any, lamp: Lamp, radius: float) -> dict[str, Any]:
    up = np.eye(3)[np.abs(lamp.towards).argmin()]
    distance = LAMP_DISTANCE * radius
    origin = (distance * lamp.towards).tolist()
    to_world = mi.ScalarTransform4f().look_at(origin=origin, target=[0, 0, 0], up=up.tolist())
    return {
        "type": "disk",
        "to_world": to_world @ mi.ScalarTransform4f().scale(float(distance * np.tan(lamp.half_angle))),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": lamp.radiance.tolist()}},
    }


# Both


def _sensor(mi: Any, subject: Subject) -> dict[str, Any]:
    view = subject.view
    width, height = view.size
    target, up = view.eye - view.rotation[:, 2], view.rotation[:, 1]
    look = mi.ScalarTransform4f().look_at(origin=view.eye.tolist(), target=target.tolist(), up=up.tolist())
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"}}
    return {
        "type": "perspective",
        "to_world": look,
        "film": film,
        "sampler": {"type": "independent"},
        "fov_axis": "y",
        "fov": float(2.0 * np.degrees(np.arctan(view.half_tangent))),
        "near_clip": 1e-3 * subject.radius,
    }


def _surroundings(mi: Any, subject: Subject) -> dict[str, Any]:
    around = subject.surrounding
    if around is None:
        return {}
    width = around.radiance.shape[1]
    # The middle of Mitsuba's map is at +z, of ours at -z.
    turned = np.ascontiguousarray(np.roll(around.radiance, -(width // 2), axis=1), np.float32)
    to_world = mi.ScalarTransform4f().rotate([0, 1, 0], around.rotation_deg - 180.0 / width)
    return {"surroundings": {"type": "envmap", "bitmap": mi.Bitmap(turned), "to_world": to_world}}


def _object(mi: Any, subject: Subject, inside: dict[str, Any]) -> Any:
    properties, faces = mi.Properties(), subject.surface.faces
    properties["face_normals"] = True
    properties["bsdf"] = mi.load_dict({"type": "dielectric", "int_ior": subject.materials[0].eta, "ext_ior": 1.0})
    for name, medium in inside.items():
        properties[name] = mi.load_dict(medium)
    shape = mi.Mesh("object", len(faces.vertices), len(faces.corners), props=properties)
    arrays = mi.traverse(shape)
    arrays["vertex_positions"] = np.ascontiguousarray(faces.vertices, np.float32).ravel()
    arrays["faces"] = np.ascontiguousarray(faces.corners, np.uint32).ravel()
    arrays.update()
    return shape
