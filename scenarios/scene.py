"""Scene: what a scenario builds, drives and checks. One scene is one pybullet client."""

import contextlib
import dataclasses
import time
from types import SimpleNamespace

import numpy as np
import pybullet as p

from bullet_tendon import Recorder, Recording, SolverOptions, TendonWorld, framing, view

REPLAY_FRAMES = 1200  # at most; a longer run is thinned out


class CutShort(Exception):
    """The scene was stopped before its end: by the limit on its steps, or with its window."""


@dataclasses.dataclass(frozen=True)
class Options:
    """What is asked of a run.

    gui: in pybullet's window, in real time. picture: whether marked moments are photographed. replay: whether
    the run is recorded for a replay. steps: the most steps to take, None for all that the scenario wants.
    integrator: of the scene's world, as in SolverOptions; a scenario that compares methods gives its worlds
    options of their own.
    """

    gui: bool = False
    picture: bool = False
    steps: int | None = None
    integrator: str = "implicit_euler"
    replay: bool = False


@dataclasses.dataclass(frozen=True)
class Check:
    """One thing that has to hold. bound: in words, as in ">= 0.98"; ok: whether value is within."""

    name: str
    value: float
    bound: str
    ok: bool

    @classmethod
    def at_least(cls, name: str, value: float, bound: float) -> "Check":
        """value >= bound; what is not a number fails."""
        return cls(name, float(value), f">= {bound:.6g}", bool(value >= bound))

    @classmethod
    def at_most(cls, name: str, value: float, bound: float) -> "Check":
        """value <= bound; what is not a number fails."""
        return cls(name, float(value), f"<= {bound:.6g}", bool(value <= bound))

    @classmethod
    def above(cls, name: str, value: float, bound: float) -> "Check":
        """value > bound; what is not a number fails."""
        return cls(name, float(value), f"> {bound:.6g}", bool(value > bound))

    @classmethod
    def equal(cls, name: str, value: float, bound: float) -> "Check":
        """value == bound, for counts."""
        return cls(name, float(value), f"== {bound:.6g}", bool(value == bound))


class Scene:
    """A client with a TendonWorld, and what a run of it measures.

    options: of the run. time_step [s] and gravity [m/s^2] (along z) are given to pybullet; solver:
    SolverOptions of the world, by default with the run's integrator. Scenarios fill in the rest:

    bones: ids of bodies that pictures show as if one could look into them. camera: arguments of
    view.camera_image for pictures and the window. labels: xlabel, ylabel, title of the picture's plot;
    plotted: names of the series in it, None for all. map_labels: of abscissa, ordinate and values of maps.
    note: a line that is printed below the table. recorder: of the run, for a replay. names: of
    bodies, by id, to be written on the first moment of a picture.
    Any further attribute may be set, as a place for a scenario's own handles.
    """

    def __init__(
        self,
        options: Options | None = None,
        time_step: float = 1 / 240,
        gravity: float = -9.81,
        solver: SolverOptions | None = None,
    ):
        self.options = Options() if options is None else options
        self.client: int = p.connect(p.GUI if self.options.gui else p.DIRECT)
        p.setGravity(0, 0, gravity, self.client)
        p.setTimeStep(time_step, self.client)
        self.time_step = time_step
        if solver is None:
            solver = SolverOptions(integrator=self.options.integrator)
        self.world = TendonWorld(self.client, solver)
        self.bones: list[int] = []
        self.camera = {"target": (0, 0, 0), "distance": 0.3, "yaw": 30, "pitch": -30}
        self.labels = {"xlabel": "time [s]", "ylabel": "", "title": ""}
        self.plotted: list[str] | None = None
        self.note = ""
        self.handles = SimpleNamespace()
        self.measured: dict[str, float] = {}
        self.units: dict[str, str] = {}
        self.names: dict[int, str] = {}
        self.frames: list[tuple] = []
        self.steps = 0
        self.time = 0.0
        self.unconverged = 0
        self.finite = True
        self.maps: list[dict] = []
        self.map_labels = ("", "", "")
        self._series: dict[str, tuple[list[float], list[float]]] = {}
        self.recorder: Recorder | None = None
        self._recorded: TendonWorld | None = None
        self._window: view.Window | None = None
        self._shown: TendonWorld | None = None
        self._clock = 0.0  # when the last step was shown [s]

    @property
    def tendons(self) -> tuple:
        """The world's tendons."""
        return self.world.tendons

    @property
    def tunnels(self) -> list[tuple]:
        """(start, end, radius) of the world's tunnels where their bones are now [m], world frame."""
        return [placed(tunnel, self.client) for tunnel in self.world.tunnels]

    @property
    def series(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """What was recorded, by name: abscissae in ascending order, by default times [s], and values."""
        return {name: _sorted(np.array(x), np.array(y)) for name, (x, y) in self._series.items()}

    def step(self) -> None:
        """One step of the world, pybullet included; shows it in the window in real time.

        Counts steps that did not converge and looks whether all positions are finite. Raises
        CutShort where no more steps are allowed, or the window was closed.
        """
        if self.steps == self.options.steps:
            raise CutShort(f"after {self.steps} steps")
        if self.options.replay:
            self._follow()
        self.world.step()
        self.steps += 1
        self.time += self.time_step
        self.unconverged += not self.world.report.converged
        self.finite &= all(np.isfinite(tendon.positions).all() for tendon in self.tendons)
        if self.options.gui:
            self._show()

    def health(self) -> list[Check]:
        """The checks that every scene has: all steps converged, all positions were finite."""
        return [
            Check.at_least("steps", self.steps, 1),
            Check.equal("steps that did not converge", self.unconverged, 0),
            Check("positions finite", float(self.finite), "true", self.finite),
        ]

    def measure(self, name: str, value: float, unit: str = "") -> None:
        """Set a measurement, for the table and JSON."""
        self.measured[name], self.units[name] = float(value), unit

    def lowest(self, name: str, value: float, unit: str = "") -> None:
        """Keep the lowest value so far as a measurement; what is not a number stays."""
        self.measure(name, np.minimum(self.measured.get(name, np.inf), value), unit)

    def highest(self, name: str, value: float, unit: str = "") -> None:
        """Keep the highest value so far as a measurement; what is not a number stays."""
        self.measure(name, np.maximum(self.measured.get(name, -np.inf), value), unit)

    def record(self, name: str, value: float, at: float | None = None) -> None:
        """Append to a series, at a time [s] (None: now) or another abscissa."""
        x, y = self._series.setdefault(name, ([], []))
        x.append(self.time if at is None else float(at))
        y.append(float(value))

    def mark(
        self, title: str, camera: dict | None = None, opacity: float = 0.4, tendons=None, colors=view.PALETTE
    ) -> None:
        """Photograph this moment, if a picture is wanted, with `camera` (None: the scene's).

        opacity: of the bones. tendons: or skins of them, drawn in `colors` by turns; None: the world's.
        """
        if not self.options.picture:
            return
        shot = {"width": 960, "height": 720, **self.camera, **(camera or {})}
        shown = self.tendons if tendons is None else tendons
        image = view.render_scene(self.client, shot, self.bones, shown, self.tunnels, opacity, colors)
        self.frames.append((title, image, [] if self.frames else self._notes(shot)))

    def map(self, title: str, x, y, values, **further) -> None:
        """Keep values (len(y), len(x)) >= 0 at abscissae x and ordinates y, for the picture.

        further: label, marks, down of a map of view.figure.
        """
        self.maps.append({"title": title, "x": x, "y": y, "values": values, **further})

    def draw(self, path: str) -> None:
        """Write the picture: a row of the marked moments above the maps above a plot of the series."""
        names = list(self.series) if self.plotted is None else [n for n in self.plotted if n in self.series]
        curves = [{"x": self.series[n][0], "y": self.series[n][1], "label": n} for n in names]
        view.figure(path, self.frames, curves, maps=self.maps, map_labels=self.map_labels, **self.labels)

    @property
    def recording(self) -> Recording:
        """What was recorded of the run for a replay, with a camera that sees the whole scene."""
        self._follow()
        found = self.recorder.recording
        return dataclasses.replace(found, camera=framing.overview(found, self.camera))

    def replay(self, path: str) -> None:
        """Write the replay of the run, an HTML file; of several worlds, of the one that was stepped last."""
        self.recording.save(path)

    def close(self) -> None:
        """Disconnect the client; a second call does nothing."""
        if p.isConnected(self.client):
            p.disconnect(self.client)

    def __enter__(self) -> "Scene":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _notes(self, shot: dict) -> list[tuple]:
        """The bodies' names, each in the middle of what is seen of its body: text, column and row."""
        with view.Camera(self.client, **shot) as camera:
            seen = camera.segmentation()
        places = {name: np.argwhere(seen == body) for body, name in self.names.items()}
        return [(name, *place.mean(axis=0)[::-1]) for name, place in places.items() if len(place)]

    def _follow(self) -> None:
        """Record the present world."""
        if self._recorded is self.world:
            return
        told = {"camera": self.camera, "bones": self.bones or None, "title": self.labels["title"]}
        self.recorder = Recorder(self.world, every=1, most_frames=REPLAY_FRAMES, **told)
        self._recorded = self.world

    def _show(self) -> None:
        if self._window is None:
            self._look()
        if self._shown is not self.world:
            self._replace_window()
        if not self._window.update():
            raise CutShort("with its window")
        self._clock = max(self._clock + self.time_step, time.perf_counter() - 0.1)
        time.sleep(max(0.0, self._clock - time.perf_counter()))

    def _replace_window(self) -> None:
        """Show the present world's tendons, and no others."""
        if self._window is not None:
            self._window.close()
        self._window, self._shown = view.Window(self.world), self.world

    def _look(self) -> None:
        """Set the window's camera, and make the bones transparent."""
        seen = [self.camera[key] for key in ("distance", "yaw", "pitch", "target")]
        p.resetDebugVisualizerCamera(*seen, physicsClientId=self.client)
        p.configureDebugVisualizer(p.COV_ENABLE_GUI, 0, physicsClientId=self.client)
        for body in self.bones:
            for row in p.getVisualShapeData(body, physicsClientId=self.client):
                with contextlib.suppress(p.error):
                    p.changeVisualShape(
                        body, row[1], rgbaColor=(*row[7][:3], 0.4), physicsClientId=self.client
                    )


def _sorted(x, y) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(x, kind="stable")
    return x[order], y[order]


def placed(tunnel, client: int) -> tuple:
    """(start, end, radius) of a tunnel where its bone is now [m], world frame."""
    if tunnel.linkIndex < 0:
        centre = p.getBasePositionAndOrientation(tunnel.bodyUniqueId, client)
        inertial = p.getDynamicsInfo(tunnel.bodyUniqueId, -1, client)[3:5]
        frame = p.multiplyTransforms(*centre, *p.invertTransform(*inertial))
    else:
        frame = p.getLinkState(tunnel.bodyUniqueId, tunnel.linkIndex, 0, 1, client)[4:6]
    ends = (
        np.array(p.multiplyTransforms(*frame, end.tolist(), (0, 0, 0, 1))[0])
        for end in (tunnel.start, tunnel.end)
    )
    return (*ends, tunnel.radius)
