"""Scenes and views that the tests of `scenegraph.render` share."""

from __future__ import annotations

import numpy as np

from scenegraph import Geode, Group, Mesh, Scene, Transform, View

BOX = Mesh.box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0))
FAR = (4_000_123.25, 500_321.5, 100.125)


def ball(rings: int, segments: int, *, smooth: bool = True, **look: object) -> Mesh:
    """A closed ball of radius 1."""
    polar = np.linspace(0, np.pi, rings + 1)[1:-1, None]
    turn = np.arange(segments) * 2 * np.pi / segments
    ring = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn], axis=-1)
    points = np.vstack([[[0, 0, 1]], ring.reshape(-1, 3), [[0, 0, -1]]])
    i = np.arange(segments)
    j = (i + 1) % segments
    faces = [np.stack([0 * i, 1 + i, 1 + j], axis=1)]
    for a in range(1, 1 + (rings - 2) * segments, segments):
        b = a + segments
        faces += [np.stack([a + i, b + i, b + j], axis=1), np.stack([a + i, b + j, a + j], axis=1)]
    last = len(points) - 1
    faces.append(np.stack([0 * i + last, last - segments + j, last - segments + i], axis=1))
    if smooth:
        look["normals"] = points
    return Mesh(points, np.concatenate(faces), **look)  # type: ignore[arg-type]


def town(offset: tuple[float, float, float] = (0.0, 0.0, 0.0), *, translucent: bool = True) -> Scene:
    """What drawing must cope with: boxes, some mirrored; smooth, heavy, textured, colored and translucent meshes."""
    rng = np.random.default_rng(7)
    group = Group()
    for i in range(225):
        place = ((i % 15 - 7) * 12.0, (i // 15 - 7) * 12.0, 0.0)
        size = (8.0, -8.0 if i % 3 == 0 else 8.0, float(rng.uniform(3, 20)))
        color = rng.uniform(0.3, 1.0, 3).tolist()
        group.add(Transform(Geode(BOX, color=color), translation=place, scale=size, rotation=(7.0 * i, (0, 0, 1))))
    heavy, light = ball(36, 36), ball(8, 8)
    for i in range(8):
        place = (*rng.uniform(-50, 50, 2), 24.0)
        size = (4.0, 4.0, -3.0 if i % 2 else 3.0)
        group.add(Transform(Geode(heavy if i % 4 < 2 else light, color=(0.9, 0.2, 0.2)), translation=place, scale=size))
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32], image[32:, :32], image[32:, 32:] = (255, 0, 0), (0, 255, 0), (255, 255, 255)
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    sign = Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=[[0, 0], [1, 0], [1, 1], [0, 1]], texture=image, color=(1, 1, 1))
    group.add(Transform(Geode(sign, name="sign"), translation=(-10, -65, 12), scale=20))
    shades = np.column_stack(
        [(heavy.vertices * 127 + 128).astype(np.uint8), np.full(len(heavy.vertices), 255, np.uint8)]
    )
    group.add(Transform(Geode(ball(36, 36, vertex_colors=shades, color=(1, 1, 1))), translation=(10, -70, 15), scale=5))
    if translucent:
        group.add(Transform(Geode(BOX, color=(0, 0, 1, 0.4), name="glass"), translation=(25, -72, 5), scale=14))
    return Scene(Group(Transform(group, translation=offset)))


def town_views(offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, View]:
    """Looks from above, along a street, without perspective, and from inside a building."""
    at = np.asarray(offset)
    above = View(at + (-20, -160, 60), at, near=1, far=1000, width=480, height=270)
    return {
        "above": above,
        "street": View(at + (6, -95, 2), at + (6.5, 0, 4), near=0.1, far=1000, width=480, height=270),
        "parallel": View(at + (-20, -160, 60), at, near=1, far=1000, width=480, height=270, parallel_scale=60.0),
        "inside": View(at + (0.5, 0.5, 1), at + (10, 3, 1), near=0.01, far=1000, width=480, height=270),
    }
