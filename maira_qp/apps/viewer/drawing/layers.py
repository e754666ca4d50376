"""What is laid over the scene beside the arm: a map of its reach, and tool poses as seen from a base."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from maira_qp.apps.viewer.panel.controls import Ask
from maira_qp.errors import OptionError
from maira_qp.orientation import quaternion_from_matrix

if TYPE_CHECKING:
    from maira_qp.scale.placement.placements import Placements
    from maira_qp.scale.reach.reach_map import ReachMap
    from maira_qp.scale.reach.surface import MapSurface

Layer = Callable[[viser.ViserServer, Ask], None]
"""Draws itself, with its own controls below those of the panel."""
GRADIENT = np.array([[0, 32, 76], [67, 78, 108], [125, 124, 120], [188, 175, 111], [255, 234, 70]], dtype=float)
"""Colours from the smallest value to the largest: dark blue to yellow, which the colour-blind and grey print keep."""
REACHED, LOST, SURFACE = (47, 158, 68), (224, 49, 49), (67, 78, 108)
MOST_POINTS = 60_000
"""Of a map: of a larger one every second cell, or third, ... along each axis."""
QUANTITIES = ("reachable", "unreachable", "undecided", "directions_open", "manipulability", "limit_distance")
CUTS = ("whole", "x", "y", "z")


def colours(values: np.ndarray) -> np.ndarray:
    """Colours (N, 3) of values (N,), from the smallest to the largest."""
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    share = (values - low) / (high - low) if high > low else np.ones(len(values))
    places = np.linspace(0.0, 1.0, len(GRADIENT))
    return np.column_stack([np.interp(share, places, channel) for channel in GRADIENT.T]).astype(np.uint8)


def cells_shown(
    reach: ReachMap, quantity: str, least: float, cut: str, at: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Points (N, 3) [m] and values (N,) of the cells where at least such a share of the orientations is reached, and
    the edge [m] of what a point stands for; with a cut "x", "y" or "z" those on one side of `at` [m] are left out."""
    values, grid = reach.values(quantity), reach.job.positions
    stride = 1
    while np.prod([-(-n // stride) for n in values.shape]) > MOST_POINTS:
        stride += 1
    some = (slice(None, None, stride),) * 3
    axes = [grid.axis(k)[::stride] for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    share, flat = reach.values("reachable")[some].ravel(), values[some].ravel().astype(float)
    shown = (share >= least) & (share > 0) & np.isfinite(flat)
    if cut != "whole":  # what is before the plane, as the camera of a new tab stands, is left out
        along = points[:, CUTS.index(cut) - 1]
        shown &= along >= at if cut == "y" else along <= at
    return points[shown], flat[shown], grid.cell * stride


def put_points(
    server: viser.ViserServer, name: str, points: np.ndarray, colour: np.ndarray, size: float, *, visible: bool = True
) -> None:
    """Draw points (N, 3) [m] in their colours (N, 3), in place of those of the same name."""
    server.scene.add_point_cloud(
        name,
        points.astype(np.float32),
        colour,
        point_size=size,
        point_shape="circle",
        precision="float32",
        point_shading="flat",
        visible=visible and bool(len(points)),
    )


def surface_shown(reach: ReachMap, quantity: str, share: float) -> MapSurface | None:
    """The surface on which a quantity has such a share of its largest value; None where there is none."""
    high = float(np.nanmax(reach.values(quantity), initial=0.0))
    try:
        return reach.surface(quantity, share * high)
    except OptionError:  # at either end of the slider
        return None


def put_mesh(server: viser.ViserServer, name: str, surface: MapSurface | None) -> None:
    """Draw a surface one can look through, in place of that of the same name; None: nothing."""
    empty = np.zeros((3, 3)), np.array([[0, 1, 2]])
    vertices, faces = empty if surface is None else (surface.vertices, surface.faces)
    server.scene.add_mesh_simple(
        name,
        vertices.astype(np.float32),
        faces.astype(np.uint32),
        color=SURFACE,
        opacity=0.4,
        side="double",
        visible=surface is not None,
    )


def map_of(reach: ReachMap) -> Layer:
    """A map, a point for each cell by a quantity, cut where one likes; and a surface of it, if one likes."""

    def draw(server: viser.ViserServer, ask: Ask) -> None:
        grid = reach.job.positions
        low = min(float(grid.axis(k)[0]) for k in range(3))
        high = max(float(grid.axis(k)[-1]) for k in range(3))
        with server.gui.add_folder("Map of the reach"):
            shown = server.gui.add_checkbox("Show map", True)
            quantity = server.gui.add_dropdown("Quantity", QUANTITIES, initial_value="reachable")
            least = server.gui.add_slider("Reached at least", 0.0, 1.0, 0.05, 0.5, hint="share of the orientations")
            cut = server.gui.add_dropdown("Cut", CUTS, initial_value="y")
            half = float(grid.axis(1)[len(grid.axis(1)) // 2])
            at = server.gui.add_slider("Cut at", low, max(high, low + grid.cell), grid.cell, half, hint="[m]")
            is_possible = importlib.util.find_spec("skimage") is not None
            hint = "of the quantity" if is_possible else "needs maira-qp[surface]"
            surface = server.gui.add_checkbox("Surface", False, disabled=not is_possible, hint=hint)
            level = server.gui.add_slider("Surface at", 0.0, 1.0, 0.05, 0.5, hint="share of the largest value")

        def put(_: Any = None) -> None:
            points, values, edge = cells_shown(reach, quantity.value, least.value, cut.value, at.value)
            put_points(server, "/map of the reach", points, colours(values), 0.2 * edge, visible=shown.value)

        def put_surface(_: Any = None) -> None:
            found = surface_shown(reach, quantity.value, level.value) if surface.value else None
            put_mesh(server, "/surface of the reach", found)

        for control in (shown, quantity, least, cut, at):
            control.on_update(put)  # type: ignore[attr-defined]
        for control in (surface, level, quantity):
            control.on_update(put_surface)  # type: ignore[attr-defined]
        put()

    return draw


def seen_from_base(found: Placements) -> Layer:
    """The poses and the floor as seen from the best base: green is reached; a slider takes the arm to each pose."""
    from maira_qp.scale.placement.candidates import poses_of_bases, seen_from

    best = found[0]
    base = poses_of_bases(best.values[None])
    poses = seen_from(base, found.poses)[0]
    floor = np.tile(np.eye(4), (found.floor.size, 1, 1))
    floor[:, :2, 3] = np.stack(np.meshgrid(found.axes[0], found.axes[1], indexing="ij"), axis=-1).reshape(-1, 2)
    floor[:, 2, 3] = best.values[2]
    size = found.robot.length

    def draw(server: viser.ViserServer, ask: Ask) -> None:
        quaternions = np.array([quaternion_from_matrix(T[:3, :3]) for T in poses])
        server.scene.add_batched_axes(
            "/poses/axes", quaternions, poses[:, :3, 3], axes_length=0.05 * size, axes_radius=0.003 * size
        )
        marks = np.where(best.solution.success[:, None], REACHED, LOST).astype(np.uint8)
        put_points(server, "/poses/points", poses[:, :3, 3], marks, 0.012 * size)
        where = seen_from(base, floor)[0, :, :3, 3]
        put_points(server, "/floor", where, colours(found.floor.ravel()), 0.015 * size)
        with server.gui.add_folder("Poses from the best base"):
            server.gui.add_markdown(f"{best.reached} of {len(poses)} poses are reached from here.")
            pose = server.gui.add_slider("Pose", 0, max(len(poses) - 1, 1), 1, 0)

        def go(_: Any = None) -> None:
            T = poses[min(int(pose.value), len(poses) - 1)]
            ask.session("target", lambda session: session.move_target(T))

        pose.on_update(go)
        go()

    return draw
