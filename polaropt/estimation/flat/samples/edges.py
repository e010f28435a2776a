"""Edges of the layers behind windows before a polarization camera: what they tell of where images lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

from polaropt.estimation.flat.windows.axis import scene_of
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.optics import SceneParameters

LayerEdges = Callable[[SceneParameters], tuple[float, float]]
"""Logarithms of the edges that transmission and reflection have behind a complete scene."""


@dataclass(frozen=True)
class WindowEdges:
    """Edges that the layers of a mosaic have behind windows of one azimuth; each is a closed form.

    Attributes
    ----------
    known : SceneParameters
        With the azimuth of the windows.
    of_layers : LayerEdges
        Of scenes in pixels of some capture.
    to_capture : float
        Of such pixels in one of the sensor's, which the windows are in.
    """

    known: SceneParameters
    of_layers: LayerEdges
    to_capture: float

    def fewer(self, window: Window) -> float:
        """Share by which the layers have fewer behind a window than behind it with its images on the other side."""
        scene = self._scene(window)
        return sum(self._edges(scene.opposite())) - sum(self._edges(scene))

    def more_behind(self, window: Window, other: Window) -> float:
        """Share by which the transmission has more behind a window than behind another one."""
        return self._edges(self._scene(window))[0] - self._edges(self._scene(other))[0]

    def _scene(self, window: Window) -> SceneParameters:
        scene = scene_of(window, self.known.azimuth_deg or 0.0, self.known.replace(gap_shift=None))
        return scene.scaled(self.to_capture)

    @cached_property
    def _edges(self) -> LayerEdges:
        """Those of the layers, each scene asked for once."""
        return cache(self.of_layers)
