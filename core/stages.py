"""Run a stage only when something that it depends on has changed, and keep the time that it took."""

import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Any, NoReturn, Self, TypeVar

T = TypeVar("T")
# Work that yields wherever it may be left for a while: nothing, or what it has begun elsewhere and goes on after.
Steps = Generator[Future[Any] | None, None, T]


@unique
class Part(StrEnum):
    """A part of the pipeline: what a setting moves is declared by it, and every stage belongs to one."""

    OBJECT = "object"  # of a photograph: made anew, it is another mesh, which is how the shape follows
    SHAPE = "shape"  # the mesh
    BODIES = "bodies"  # which of it scatters light together
    SAMPLES = "samples"  # of its surface, as dense as transport's nodes ask for
    SURFACE = "surface"  # colours and relief
    LIGHT = "light"  # lamps, probe, and their shadows
    OCCLUSION = "occlusion"  # of the light from all around by the object itself
    IRRADIANCE = "irradiance"  # what enters the surface
    TRANSPORT = "transport"  # through the object, up to the volume that pixels read
    VIEW = "view"  # where the picture is taken from, and its size
    LOOK = "look"  # radiance of the pixels
    GROUND = "ground"  # that the object stands on
    DISPLAY = "display"  # exposure to sRGB
    PHOTOGRAPH = "photograph"  # that the object is put into

    @property
    def upstream(self) -> frozenset["Part"]:
        """The part, and all whose results reach it."""
        return frozenset({self}).union(*(part.upstream for part in _READ[self]))

    @property
    def downstream(self) -> frozenset["Part"]:
        """The part, and all that its result reaches."""
        return frozenset(part for part in Part if self in part.upstream)


# Part -> those whose results it reads.
_READ = {
    Part.OBJECT: (),
    Part.SHAPE: (),
    Part.BODIES: (Part.SHAPE,),
    Part.SAMPLES: (Part.SHAPE,),
    Part.SURFACE: (Part.SAMPLES,),
    Part.LIGHT: (Part.SHAPE, Part.BODIES),
    Part.OCCLUSION: (Part.SHAPE,),
    Part.IRRADIANCE: (Part.SURFACE, Part.LIGHT, Part.OCCLUSION),
    Part.TRANSPORT: (Part.IRRADIANCE, Part.BODIES),
    Part.VIEW: (Part.SHAPE, Part.BODIES, Part.OCCLUSION),
    Part.LOOK: (Part.TRANSPORT, Part.VIEW),
    Part.GROUND: (Part.TRANSPORT, Part.VIEW),
    Part.DISPLAY: (Part.LOOK, Part.GROUND),
    Part.PHOTOGRAPH: (Part.OBJECT, Part.LOOK),
}


@unique
class Stage(StrEnum):
    """Every stage, by the words that tables of times and CSV files show; part by part.

    Attributes
    ----------
    part : Part
    """

    part: Part

    def __new__(cls, words: str, part: Part) -> Self:
        """Make a member of its words and the part that it belongs to."""
        stage = str.__new__(cls, words)
        stage._value_, stage.part = words, part
        return stage

    DEPTH_AND_SURFACE = "depth and surface", Part.OBJECT

    MODEL = "model", Part.SHAPE
    CLEAR_PARTS = "clear parts", Part.IRRADIANCE

    BODIES_OF_KINDS = "bodies of each kind of matter", Part.OBJECT
    MATTER = "matter of bodies", Part.TRANSPORT
    TOUCHING = "parts that touch", Part.OBJECT
    FIND_BODIES = "find bodies", Part.BODIES
    BODY_MARKS = "body marks", Part.BODIES
    CLEAR_MARKS = "marks of clear parts", Part.BODIES
    CLEAR_BUFFERS = "clear parts to draw", Part.BODIES

    ROUGHNESS = "roughness", Part.SAMPLES
    THICKNESS = "thickness", Part.SAMPLES
    SAMPLES = "samples", Part.SAMPLES

    DETAIL = "detail", Part.SURFACE
    SAMPLE_DETAIL = "detail of samples", Part.SURFACE
    SAMPLE_RELIEF = "relief of samples", Part.SURFACE
    SAMPLE_TINTS = "tints of samples", Part.SURFACE
    SAMPLE_WEIGHTS = "weights of samples", Part.SURFACE
    NODE_TINTS = "tints at nodes", Part.SURFACE
    SAMPLE_BUFFERS = "sample buffers", Part.SURFACE

    PROBE = "probe", Part.LIGHT
    PROBE_SOURCES = "probe sources", Part.LIGHT
    LIGHT = "light", Part.LIGHT
    LIGHT_SHADOW = "shadow of light", Part.LIGHT
    PROBE_SOURCE = "probe source", Part.LIGHT
    PROBE_SOURCE_SHADOW = "shadow of probe source", Part.LIGHT
    LIGHT_ONTO_GROUND = "light past clear parts", Part.LIGHT
    SHADOW_ONTO_GROUND = "shadow of light past clear parts", Part.LIGHT
    HIGHLIGHT_LOBES = "highlight lobes", Part.LIGHT
    SURROUNDINGS = "surroundings of rays", Part.LIGHT

    VISIBILITY = "visibility", Part.OCCLUSION
    EXCHANGE_RAYS = "rays between parts", Part.OCCLUSION
    FEW_CROSSINGS = "a few rays through thin parts", Part.OCCLUSION
    CROSSING_RAYS = "rays through thin parts", Part.OCCLUSION
    REFINED_MESH = "refined mesh", Part.OCCLUSION
    OCCLUSION = "occlusion", Part.OCCLUSION

    ENVIRONMENT_TABLE = "environment table", Part.IRRADIANCE
    ENVIRONMENT_LIGHT = "environment light", Part.IRRADIANCE
    INDICES = "indices of refraction of bodies", Part.IRRADIANCE
    OF_KIND = "samples of bodies of one kind", Part.IRRADIANCE
    EXCHANGE = "exchange between parts", Part.IRRADIANCE
    MIRROR = "mirror", Part.OCCLUSION
    NO_EXCHANGE = "no exchange between parts", Part.IRRADIANCE
    EXCHANGE_THROUGH = "exchange through thin parts", Part.IRRADIANCE
    MIRRORED = "mirrored surroundings", Part.IRRADIANCE
    CROSSED = "surroundings through thin parts", Part.IRRADIANCE
    LAMP_RAYS = "rays to lamp", Part.IRRADIANCE
    MIRRORED_LAMP = "mirrored light", Part.IRRADIANCE
    CROSSING_LAMP = "rays through thin parts from lamp", Part.IRRADIANCE
    CROSSED_LAMP = "light through thin parts from lamp", Part.IRRADIANCE
    FROM_LAMPS = "unscattered light from lamps", Part.IRRADIANCE
    UNSCATTERED = "unscattered light to come", Part.IRRADIANCE
    UNSCATTERED_SUM = "all unscattered light", Part.IRRADIANCE
    UNSCATTERED_LIGHT = "unscattered light", Part.IRRADIANCE
    TOTAL_FLUX = "flux with unscattered light", Part.IRRADIANCE
    SAMPLE_LEAVING = "leaving tints of samples", Part.SURFACE
    EXCHANGE_SAMPLES = "interpolation at samples", Part.IRRADIANCE
    UNSCATTERED_FLUX = "flux of unscattered light", Part.IRRADIANCE
    OCCLUDED_SAMPLES = "occluded samples", Part.IRRADIANCE
    BALL = "ball around the object", Part.IRRADIANCE
    BEAMS_OF_LIGHT = "beams of light", Part.IRRADIANCE
    BEAMS_AROUND = "beams from all around", Part.IRRADIANCE
    BEAMS = "beams", Part.IRRADIANCE
    IRRADIANCE = "irradiance of light", Part.IRRADIANCE
    FLUX = "flux", Part.IRRADIANCE
    LIGHT_FLUX = "flux of light", Part.IRRADIANCE

    TRANSPORT = "transport", Part.TRANSPORT
    LAYER_DEPTH = "layer depth", Part.TRANSPORT
    BODY_LAYERS = "body layers", Part.TRANSPORT
    CLEAR_TRANSPORT = "transport of clear matter", Part.TRANSPORT
    SEPARATE_TRANSPORT = "separate transport", Part.TRANSPORT
    BODY_SAMPLES = "body samples", Part.TRANSPORT
    BODY_FLUX = "body flux", Part.TRANSPORT
    WEIGHTS = "weights", Part.TRANSPORT
    DEPOSIT = "deposit", Part.TRANSPORT
    SPECTRA = "spectra", Part.TRANSPORT
    CONVOLUTION = "convolution", Part.TRANSPORT
    BODIES = "bodies", Part.TRANSPORT
    BODY_LIGHT_FLUX = "body flux of light", Part.TRANSPORT
    SECOND_PASS = "second pass", Part.TRANSPORT
    BODY_BEAMS = "beams through bodies", Part.TRANSPORT
    BODY_EXCHANGE = "exchange between bodies", Part.TRANSPORT
    BODY_INTERPOLATION = "interpolation in bodies", Part.TRANSPORT
    COARSE_SOLUTION = "coarse solution", Part.TRANSPORT
    RAYS = "rays", Part.TRANSPORT
    BOUNDARY = "boundary", Part.TRANSPORT
    KNOWN_PATHS = "known paths through thin parts", Part.TRANSPORT
    ENTRY = "entry of light", Part.TRANSPORT
    EXCHANGE_GEOMETRY = "places of the exchange", Part.TRANSPORT
    EVEN_LIGHT = "even light in thin parts", Part.TRANSPORT
    EVEN_SURFACE = "surface by even light", Part.TRANSPORT
    SURFACE_EXCHANGE = "exchange between patches", Part.TRANSPORT
    PATCH_FLUX = "flux into patches", Part.TRANSPORT
    RETURNED = "light that has returned", Part.TRANSPORT
    PATCH_UNSCATTERED = "unscattered flux into patches", Part.TRANSPORT
    KNOWN_UNSCATTERED = "unscattered light that is known", Part.TRANSPORT
    SURFACE_CROSSING = "exchange through thin parts of patches", Part.TRANSPORT
    SURFACE_GROUND = "exchange with the ground", Part.TRANSPORT
    SOURCES_R = "sources of R", Part.TRANSPORT
    SOURCES_G = "sources of G", Part.TRANSPORT
    SOURCES_B = "sources of B", Part.TRANSPORT
    FILLED = "filled cells", Part.TRANSPORT
    RETURNS = "light that the surface sends back", Part.TRANSPORT
    EXITS = "ways of light out", Part.TRANSPORT
    FIRST_VOLUME = "first scattering", Part.TRANSPORT
    ONWARDS = "rays of light that has scattered once", Part.TRANSPORT
    SECOND_VOLUME = "second scattering", Part.TRANSPORT
    OFTEN_SCATTERED = "often scattered light within", Part.TRANSPORT
    EVEN_BEAMS = "beams of even light", Part.TRANSPORT
    EVEN_ONWARDS = "rays of even light that has scattered once", Part.TRANSPORT
    EVENNESS = "even light within", Part.TRANSPORT
    RESOLVED = "glow within", Part.TRANSPORT
    SOLUTION = "solution", Part.TRANSPORT
    LAYER_VOLUME = "layer volume", Part.TRANSPORT
    PIXEL_TERMS = "pixel terms", Part.TRANSPORT
    MEAN_FLUENCE = "mean fluence", Part.TRANSPORT
    PIXEL_TABLES = "pixel tables", Part.TRANSPORT
    REENTRY = "light that enters again", Part.TRANSPORT
    BODY_WINDOWS = "body windows", Part.TRANSPORT
    GATHER = "gather", Part.TRANSPORT

    DEPTH = "depth", Part.VIEW
    COMPOSITE_TARGETS = "composite targets", Part.VIEW
    GBUFFER_TARGETS = "gbuffer targets", Part.VIEW
    LIGHT_TARGETS = "light targets", Part.VIEW
    REFINED_MARKS = "refined marks", Part.VIEW
    GBUFFER = "gbuffer", Part.VIEW
    DETAIL_TARGETS = "detail targets", Part.VIEW

    PATH_SURFACE = "surface for rays", Part.IRRADIANCE
    PATHS = "rays of sight", Part.LOOK
    FLOOR = "ground for rays", Part.LOOK
    PATHS_ON_GROUND = "rays of sight above the ground", Part.LOOK
    LIT_PATHS = "rays of sight, lit", Part.LOOK
    PATH_PARTS = "parts of light along rays", Part.LOOK
    PATH_TARGETS = "ray targets", Part.LOOK
    BACK_TARGETS = "targets of the back", Part.LOOK
    BACK_FACES = "back of the surface", Part.LOOK
    SIGHT_AROUND = "surroundings of drafted rays", Part.LOOK
    SIGHT_GLOW = "glow along drafted rays", Part.LOOK
    SIGHT_TARGETS = "targets of drafted rays", Part.LOOK
    REENTRY_TARGETS = "targets of reentry", Part.LOOK
    REENTRY_BUFFERS = "buffers of reentry", Part.LOOK
    REENTRY_PIXELS = "reentry at pixels", Part.LOOK
    OCCLUSION_BEHIND = "occlusion behind", Part.LOOK
    BLOCKED_HIGHLIGHTS = "blocked highlights", Part.LOOK
    OCCLUDED_HIGHLIGHTS = "occluded highlights", Part.LOOK
    PIXEL_DETAIL = "detail of pixels", Part.LOOK
    ENVIRONMENT_HIGHLIGHTS = "environment highlights", Part.LOOK
    LAMPS_AT_VERTICES = "lamps at vertices", Part.LOOK
    LIT_VERTICES = "light at vertices", Part.LOOK
    COMPOSITE = "composite", Part.LOOK
    EXPOSURE = "exposure", Part.LOOK

    GROUND_PLANE = "ground plane", Part.LIGHT
    STANDING = "light above the ground", Part.LIGHT
    HORIZON = "horizon", Part.LIGHT
    GROUND_RAYS = "rays from the ground", Part.OCCLUSION
    GROUND_SKY = "environment on the ground", Part.IRRADIANCE
    GROUND_LAMPS = "lamps on the ground", Part.IRRADIANCE
    GROUND_SHARP_LAMPS = "sharp lamps on the ground", Part.IRRADIANCE
    GROUND_EXCHANGE = "exchange by way of the ground", Part.IRRADIANCE
    LANDINGS_OF_LIGHT = "light through the object onto the ground of light", Part.IRRADIANCE
    LANDINGS_AROUND = "light from all around through the object onto the ground", Part.IRRADIANCE
    LANDED = "light through the object on the ground", Part.IRRADIANCE
    GROUND_UNDER = "environment on the ground and through the object", Part.IRRADIANCE
    GROUND_MIRROR = "mirror of the ground", Part.IRRADIANCE
    GROUND_RETURNED = "light from the ground", Part.IRRADIANCE
    GROUND = "ground", Part.IRRADIANCE
    GROUND_DRAWN = "ground with emitters", Part.GROUND
    GROUND_EMITTERS = "emitters before the ground", Part.GROUND
    GROUND_GLOW = "glow on the ground", Part.GROUND
    GROUND_AROUND = "light around the ground", Part.GROUND
    GROUND_TARGETS = "ground targets", Part.GROUND
    GROUND_PIXELS = "ground at pixels", Part.GROUND

    BACKGROUND = "background", Part.DISPLAY
    IMAGE = "image", Part.DISPLAY
    TONE_MAP = "tone map", Part.DISPLAY

    RENDERING = "rendering", Part.PHOTOGRAPH
    PHOTO_TEXTURES = "photograph's textures", Part.PHOTOGRAPH
    PYRAMID_TARGETS = "pyramid targets", Part.PHOTOGRAPH
    PYRAMID = "pyramid", Part.PHOTOGRAPH
    BACKDROP = "photograph's backdrop", Part.PHOTOGRAPH
    PHOTOGRAPH = "photograph", Part.PHOTOGRAPH

    def of(self, number: int) -> "NumberedStage":
        """Return one of several stages alike, of the light with this number, from 1."""
        return NumberedStage(self, number)


class NumberedStage(str):
    """One of several stages alike: "shadow of light 3".

    Attributes
    ----------
    stage : Stage
    number : int
        From 1.
    """

    stage: Stage
    number: int

    def __new__(cls, stage: Stage, number: int) -> Self:
        """Make the words of both."""
        words = super().__new__(cls, f"{stage} {number}")
        words.stage, words.number = stage, number
        return words

    @property
    def part(self) -> Part:
        """The part that all of them belong to."""
        return self.stage.part


AnyStage = Stage | NumberedStage


def numbered(stage: Stage, i: int) -> AnyStage:
    """Return the stage of the first, 0, of several alike, which is without a number, or of a later one."""
    return stage.of(i + 1) if i else stage


Timings = dict[AnyStage, float]  # ms


class Unfinished(Exception):  # noqa: N818 (nothing went wrong)
    """A stage has more to do than this frame allows; asked for again in the next one, it goes on.

    Attributes
    ----------
    awaited : Future, optional
        What it waits for, if it could not go on at once.
    """

    def __init__(self, name: AnyStage, awaited: Future[Any] | None) -> None:
        super().__init__(name)
        self.awaited = awaited


class Allowance:
    """How many steps of stages that are spread over frames one frame may take, and for how long it may begin more."""

    def __init__(self, steps: int, seconds: float) -> None:
        self._steps, self._end = steps, time.perf_counter() + seconds

    def take(self) -> bool:
        """Tell whether one more step may be taken, and count it."""
        self._steps -= 1
        return self._steps >= 0 and time.perf_counter() < self._end


def exhausted(steps: Steps[T]) -> T:
    """Take all steps and return what they come to."""
    while True:
        try:
            begun = next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        if begun is not None:
            wait([begun])


@dataclass(eq=False)
class _Begun:
    """A stage on the way: what it depends on, what is left and waits for, and ms of earlier frames."""

    key: tuple[object, ...]
    steps: Steps[Any]
    awaited: Future[Any] | None = None
    spent: float = 0.0
    wanted: bool = True  # in this frame


class Stages:
    """The last result of every named stage.

    A stage states what it depends on: hashable values are compared by equality, arrays, lists and other objects by
    identity, so that results of earlier stages serve as they are.

    Parameters
    ----------
    finish : callable, optional
        Waits for work that runs elsewhere (the GPU's), so that a stage's time is its own.

    Attributes
    ----------
    timings : Timings
        Of the stages that ran since `begin`; a stage run inside another counts for itself alone.
    """

    def __init__(self, finish: Callable[[], object] = lambda: None) -> None:
        self._kept: dict[AnyStage, tuple[tuple[object, ...], Any]] = {}
        self._finish = finish
        self._nested = 0.0  # ms spent in the stages that ran inside the current one
        self.timings: Timings = {}
        self._begun: dict[AnyStage, _Begun] = {}
        self._allowance: Allowance | None = None

    def begin(self, allowance: Allowance | None = None) -> None:
        """Start a new frame: forget the timings, keep the results, and drop what is half done and no longer wanted.

        Stages that `spread` runs take as many steps as the frame has an allowance for, without one all of them.
        """
        self.timings, self._allowance = {}, allowance
        self._begun = {name: begun for name, begun in self._begun.items() if begun.wanted}
        for begun in self._begun.values():
            begun.wanted = False

    def has(self, name: AnyStage, depends_on: Iterable[object]) -> bool:
        """Whether `run` would return what it kept."""
        kept = self._kept.get(name)
        return kept is not None and alike(kept[0], tuple(depends_on))

    def kept(self, name: AnyStage) -> tuple[tuple[object, ...], Any] | None:
        """Return what a stage last depended on and gave, outdated or not: parts of it may serve again."""
        return self._kept.get(name)

    def forget(self, name: AnyStage) -> None:
        """Drop a stage's result, because what it holds is no longer what it says."""
        self._kept.pop(name, None)

    def clear(self) -> None:
        """Drop all results, and keep the timings."""
        self._kept.clear()
        self.abandon()

    def abandon(self, *names: AnyStage) -> None:
        """Drop what is half done, of some stages or of all."""
        for name in names or tuple(self._begun):
            self._begun.pop(name, None)

    def run(self, name: AnyStage, depends_on: Iterable[object], compute: Callable[[], T]) -> T:
        """Return the stage's result, computing it only if `depends_on` differs from the last time."""
        key = tuple(depends_on)
        if self.has(name, key):
            return self._kept[name][1]  # type: ignore[no-any-return]
        self._kept.pop(name, None)  # free the old result before the new one is allocated
        outer, self._nested = self._nested, 0.0
        start = time.perf_counter()
        try:
            result = compute()
            self._finish()
        finally:
            elapsed = 1e3 * (time.perf_counter() - start)
            self.timings[name] = self.timings.get(name, 0.0) + elapsed - self._nested
            self._nested = outer + elapsed
        self._kept[name] = (key, result)
        return result

    def spread(self, name: AnyStage, depends_on: Iterable[object], work: Callable[[], Steps[T]]) -> T:
        """Return the stage's result as `run` does, of work in steps: a frame takes one, then what its allowance leaves.

        Raises
        ------
        Unfinished
            Where steps are left.
        """
        key = tuple(depends_on)
        if self.has(name, key):
            return self._kept[name][1]  # type: ignore[no-any-return]
        begun = self._begun.get(name)
        if begun is None or not alike(begun.key, key):
            begun = self._begun[name] = _Begun(key, work())
        begun.wanted = True
        result: T = self.run(name, key, lambda: self._proceed(name, begun))
        self.timings[name] += begun.spent
        return result

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Have stages take all of their steps until the block ends, whatever the frame's allowance."""
        allowance, self._allowance = self._allowance, None
        try:
            yield
        finally:
            self._allowance = allowance

    def _proceed(self, name: AnyStage, begun: _Begun) -> Any:
        start = time.perf_counter()
        del self._begun[name]  # work that fails is over
        while True:
            if begun.awaited is not None and self._allowance is None:
                wait([begun.awaited])
            elif begun.awaited is not None and not begun.awaited.done():
                self._leave(name, begun, start)
            try:
                begun.awaited = next(begun.steps)
            except StopIteration as end:
                return end.value
            if self._allowance is not None:
                self._finish()
                if not self._allowance.take():
                    self._leave(name, begun, start)

    def _leave(self, name: AnyStage, begun: _Begun, start: float) -> NoReturn:
        """Leave a stage to another frame, since `start`."""
        self._begun[name] = begun
        begun.spent += 1e3 * (time.perf_counter() - start)
        awaited = begun.awaited
        raise Unfinished(name, None if awaited is None or awaited.done() else awaited)


def alike(a: tuple[object, ...], b: tuple[object, ...]) -> bool:
    """Tell whether a stage that depends on values would find others the same: hashable ones equal, others identical."""
    return len(a) == len(b) and all(map(_same, a, b))


def _same(a: object, b: object) -> bool:
    if a is b:
        return True
    try:
        return hash(a) == hash(b) and a == b
    except TypeError:
        return isinstance(a, tuple) and isinstance(b, tuple) and alike(a, b)
