"""Bodies as meshes of a scene, and the lights on them."""

from __future__ import annotations

import viser

from maira_qp.apps.viewer.drawing.geometry import Body


def light(scene: viser.SceneApi) -> None:
    """Plain lights: a map of the surroundings and shadows take a browser without a graphics card seconds a frame."""
    scene.configure_environment_map(None)
    scene.configure_default_lights(cast_shadow=False)
    scene.add_light_hemisphere("/light", sky_color=(255, 255, 255), ground_color=(170, 176, 186), intensity=1.0)


def add_surface(scene: viser.SceneApi, name: str, body: Body, opacity: float | None = None) -> viser.MeshHandle:
    """A body as a mesh of the scene."""
    return scene.add_mesh_simple(
        name,
        body.surface.vertices,
        body.surface.faces,
        color=body.colour,
        flat_shading=body.is_faceted,
        side="double",
        opacity=opacity,
    )
