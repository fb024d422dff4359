"""The 3D picture on one page: lights, obstacles and all that moves as viser nodes whose properties follow the frames."""

from dataclasses import dataclass

import numpy as np
import viser

from engine.contact.obstacles import Obstacles
from engine.geometry.handles import Handles
from engine.run.frames import Frame, LiquidFrame, StrandFrame, YarnFrame
from viewer import detail, layers, liquid_detail, shapes, strand_detail
from viewer.detail import Level
from viewer.lay import Layout
from viewer.layers import Bytes, Paint, Segments
from viewer.shapes import Instances

PANEL_SHARE = 0.12  # the scene is moved left by this share of its size, out from under the panel
SPARE = 1.2  # room for this many times the instances that have to be shown


@dataclass(frozen=True)
class Shown:
    """What the visitor wants to see."""

    lines: bool  # yarns, strands or liquid
    nodes: bool
    obstacles: bool
    paint: Paint | None = None  # None: colours of what belongs together
    level: Level = "auto"
    focus: tuple[float, float, float] = (0.0, 0.0, 0.0)  # middle of the region that is drawn [m]
    surface: bool = True  # of the liquid, where the frame has it and colours say nothing of the particles, in place of them


class Stage:
    """Draws frames on the page of one client. Not thread-safe: one thread draws."""

    def __init__(self, client: viser.ClientHandle):
        self._client = client
        self._obstacles: list[viser.MeshHandle] = []
        self._yarns: viser.BatchedMeshHandle | None = None
        self._strands: viser.BatchedMeshHandle | None = None
        self._nodes: viser.BatchedMeshHandle | None = None
        self._liquid: viser.BatchedMeshHandle | None = None
        self._surface: viser.MeshHandle | None = None
        self._lights()

    def _lights(self) -> None:
        scene = self._client.scene
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        sky, ground = (255, 252, 246), (110, 106, 104)
        scene.add_light_hemisphere("/lights/sky", sky_color=sky, ground_color=ground, intensity=1.9)
        scene.add_light_directional("/lights/key", color=(255, 248, 238), intensity=2.3, position=(0.5, -0.35, 1.0))

    def clear(self) -> None:
        """Take away everything of the scene that was shown."""
        for handle in (*self._obstacles, self._yarns, self._strands, self._nodes, self._liquid, self._surface):
            if handle is not None:
                handle.remove()
        self._obstacles, self._yarns, self._strands, self._nodes = [], None, None, None
        self._liquid, self._surface = None, None

    def set_obstacles(self, obstacles: Obstacles, low: np.ndarray, high: np.ndarray) -> None:
        """Show the obstacles of a scene that extends from `low` to `high` [m]."""
        for index in range(len(obstacles.kind)):
            mesh = shapes.obstacle_mesh(obstacles, index, low, high)
            self._obstacles.append(
                self._client.scene.add_mesh_simple(f"/obstacles/{index}", mesh.vertices, mesh.faces, color=mesh.colour)
            )

    def move_obstacles(self, obstacles: Obstacles, handles: Handles, time: float) -> None:
        """Put the obstacles that are carried where they are at `time` [s], in the shape that they have then."""
        for index, move in shapes.moves(obstacles, handles, time).items():
            self._obstacles[index].position, self._obstacles[index].wxyz = move.position, move.wxyz
        for index, vertices in shapes.changed_vertices(obstacles, time).items():
            self._obstacles[index].vertices = vertices

    def frame_camera(self, low: np.ndarray, high: np.ndarray) -> None:
        """Move the camera so that the box from `low` to `high` [m] fills the picture, z up."""
        size = float(np.linalg.norm(high - low))
        camera = self._client.camera
        camera.up_direction = (0.0, 0.0, 1.0)
        camera.fov = layers.FIELD_OF_VIEW
        camera.near, camera.far = size / 500, size * 50
        eye, target = layers.viewpoint(low, high)
        right = np.cross(target - eye, (0.0, 0.0, 1.0))
        aside = PANEL_SHARE * size * right / np.linalg.norm(right)
        camera.position = eye + aside
        camera.look_at = target + aside  # after the position, which carries the old target along

    def draw(self, frame: Frame, layout: Layout, shown: Shown) -> str:
        """Show the yarns, strands and liquid of one frame; returns what part of it that is, in words."""
        for handle in self._obstacles:
            handle.visible = shown.obstacles
        said, among = [], layers.paint_among
        if frame.yarns is not None:
            said.append(self._draw_yarns(frame.yarns, layout, shown, among(layers.YARN_PAINTS, shown.paint)))
        if frame.strands is not None:
            said.append(self._draw_strands(frame.strands, shown, among(layers.STRAND_PAINTS, shown.paint)))
        if frame.liquid is not None:
            said.append(self._draw_liquid(frame.liquid, shown, among(layers.LIQUID_PAINTS, shown.paint)))
        return "; ".join(said)

    def _draw_yarns(self, yarns: YarnFrame, layout: Layout, shown: Shown, paint: Paint) -> str:
        """Show yarns as they lie, or with the nodes on thin lines where they are computed."""
        whole, yarns = yarns, detail.part(yarns, shown.level, np.array(shown.focus))
        if shown.nodes:
            segments = layers.yarn_segments(yarns, paint, layers.LINE_SCALE)
        else:
            drawn = layout(yarns, detail.budget(shown.level).segments)
            segments = layers.yarn_segments(drawn, paint)
        self._yarns = self._tubes(self._yarns, "/yarns", segments)
        self._yarns.visible = shown.lines
        if shown.nodes:
            points = layers.node_points(yarns)
            self._nodes = self._instances(self._nodes, "/nodes", shapes.UNIT_BALL, shapes.balls(points), points.colours)
        if self._nodes is not None:
            self._nodes.visible = shown.nodes
        return detail.statement(whole, yarns, shown.nodes)

    def _draw_strands(self, strands: StrandFrame, shown: Shown, paint: Paint) -> str:
        part = strand_detail.part(strands, shown.level, np.array(shown.focus))
        limit = layers.paint_limit(strands, paint)
        segments = layers.strand_segments(part.strands, paint, limit, detail.budget(shown.level).segments)
        self._strands = self._tubes(self._strands, "/strands", segments)
        self._strands.visible = shown.lines
        return part.said

    def _draw_liquid(self, liquid: LiquidFrame, shown: Shown, paint: Paint) -> str:
        """Show the surface of a liquid or its particles as balls."""
        surface = shown.surface and paint == "liquid" and len(liquid.surface_faces) > 0
        if surface:
            said = f"shown the surface, {len(liquid.surface_faces):,} triangles"
            self._surface = self._mesh(self._surface, "/surface", shapes.surface(liquid))
        else:
            part = liquid_detail.part(liquid, shown.level, np.array(shown.focus))
            said, points = part.said, layers.liquid_points(part.liquid, paint, layers.paint_limit(liquid, paint))
            unit = shapes.ball(len(points.points))
            colours = shapes.light(points.colours)  # like its surface's, which are sRGB
            self._liquid = self._instances(self._liquid, "/liquid", unit, shapes.balls(points), colours)
        if self._surface is not None:
            self._surface.visible = shown.lines and surface
        if self._liquid is not None:
            self._liquid.visible = shown.lines and not surface
        return said

    def _mesh(self, handle: viser.MeshHandle | None, name: str, mesh: shapes.Mesh) -> viser.MeshHandle:
        """Show the mesh with the node of the last frame, if there was one."""
        if handle is None:
            return self._client.scene.add_mesh_simple(name, mesh.vertices, mesh.faces, color=mesh.colour)
        handle.vertices, handle.faces = mesh.vertices, mesh.faces
        return handle

    def _tubes(self, handle: viser.BatchedMeshHandle | None, name: str, segments: Segments) -> viser.BatchedMeshHandle:
        # one colour an instance: that of the middle of the segment
        colours = segments.colours.mean(axis=1, dtype=np.float32).round().astype(np.uint8)
        return self._instances(handle, name, shapes.tube(len(segments.points)), shapes.tubes(segments), colours)

    def _instances(
        self,
        handle: viser.BatchedMeshHandle | None,
        name: str,
        unit: shapes.Shape,
        instances: Instances,
        colours: Bytes,
    ) -> viser.BatchedMeshHandle:
        """Show the instances with the node of the last frame; a new one is made only where they no longer fit."""
        room = 0 if handle is None else len(handle.batched_positions)
        count = len(instances.positions)
        fits = handle is not None and count <= room and len(handle.vertices) == len(unit[0])
        if not fits:
            room = int(count * SPARE)
        # instances to spare have no size: the number of EoL nodes changes from frame to frame
        positions, wxyzs, scales, padded = (
            np.concatenate([a, np.zeros((room - count, a.shape[1]), a.dtype)])
            for a in (instances.positions, instances.wxyzs, instances.scales, colours)
        )
        wxyzs[count:, 0] = 1
        if not fits or handle is None:
            return self._client.scene.add_batched_meshes_simple(
                name, *unit, wxyzs, positions, batched_scales=scales, batched_colors=padded, lod="off"
            )
        handle.batched_positions, handle.batched_wxyzs = positions, wxyzs
        handle.batched_scales, handle.batched_colors = scales, padded
        return handle
