"""These helpers build small robots, and write URDFs and meshes for them."""

import numpy as np
import pytest

from eskin.errors import warn_once
from eskin.robot import Box, Joint, Link, Robot, build_shape_mesh, load_urdf

TOY = """<?xml version="1.0"?>
<robot name="toy">
  <!-- a comment -->
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="base">
    <inertial><mass value="1"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/base.dae"/></geometry></visual>
    <collision>
      <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
      <geometry><box size="1 2 3"/></geometry>
    </collision>
    <collision><geometry><sphere radius="0.5"/></geometry></collision>
  </link>
  <link name="arm">
    <collision><geometry><cylinder radius="0.1" length="2"/></geometry></collision>
  </link>
  <link name="wheel"/>
  <link name="slider"/>
  <link name="tip"/>
  <joint name="lift" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0 0 1"/><axis xyz="0 2 0"/>
    <limit lower="-1" upper="2" effort="10" velocity="3"/>
    <dynamics damping="0.1"/><safety_controller k_velocity="1"/>
  </joint>
  <joint name="roll" type="continuous"><parent link="arm"/><child link="wheel"/></joint>
  <joint name="slide" type="prismatic">
    <parent link="arm"/><child link="slider"/><axis xyz="0 0 1"/>
    <limit upper="0.2" effort="1" velocity="0.5"/><mimic joint="roll" multiplier="2"/>
  </joint>
  <joint name="weld" type="fixed"><parent link="slider"/><child link="tip"/></joint>
  <transmission name="t"><joint name="lift"/><type>x</type></transmission>
  <gazebo reference="arm"><sensor name="s" type="contact"/></gazebo>
  <sensor name="skin"><parent link="arm"/><tactile/></sensor>
  <ros2_control name="c" type="system"><joint name="lift"/></ros2_control>
</robot>
"""
MESH = """<robot name="toy"><link name="base">
  <collision><geometry><mesh filename="{}" scale="{}"/></geometry></collision>
</link></robot>"""
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 684\n"
"""A file that Git LFS has left in place of another."""
PART = """<robot name="toy"><link name="part"><collision>{origin}
<geometry>{shape}</geometry></collision></link></robot>"""
COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"
version="1.4.1"><asset>{unit}<up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="s">
<float_array id="f" count="24">{numbers}</float_array><technique_common>
<accessor source="#f" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor>
</technique_common></source><vertices id="v">
<input semantic="POSITION" source="#s"/></vertices><triangles count="12">
<input semantic="VERTEX" source="#v" offset="0"/><p>{faces}</p></triangles>
</mesh></geometry></library_geometries><library_visual_scenes>
<visual_scene id="w"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""
PART_MESH = build_shape_mesh(Box((20.0, 10.0, 30.0)))
"""Mesh that stands in the file of `COLLADA` and in that of `write_off`."""


def build_robot(links, *joints):
    """Build a robot of links with names of one letter."""
    return Robot("toy", tuple(map(Link, links)), joints)


def build_joint(name, parent, child, kind="revolute", **more):
    """Build a joint about x."""
    return Joint(name, kind, parent, child, np.eye(4), np.eye(3)[0], **more)


def read_shapes(robot):
    """Return all shapes of a robot, which are read when they are needed."""
    return [geom.shape for link in robot.links for geom in link.geoms]


def write_stl(path, size=(1.0, 2.0, 3.0)):
    """Write a box as the text form of STL, in which triangles share no corners."""
    mesh = build_shape_mesh(Box(size))
    lines = ["solid thing"]
    for triangle in mesh.vertices[mesh.faces]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, "endsolid thing", ""]))


def build_chain(*followed):
    """Build a URDF of three joints in a row, each of which may follow another."""
    rule = '<mimic joint="{}" multiplier="-2" offset="0.5"/>'
    joints = "".join(
        f'<joint name="j{i}" type="prismatic"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/><limit lower="-9" upper="9" velocity="1"/>'
        f"{other and rule.format(other)}</joint>"
        for i, other in enumerate(followed)
    )
    links = "".join(f'<link name="l{i}"/>' for i in range(len(followed) + 1))
    return f'<robot name="r">{links}{joints}</robot>'


def write_off(folder):
    """Write `PART_MESH` as an OFF file, and skip where none can be read."""
    pytest.importorskip("trimesh")
    lines = ["OFF", "8 12 0", *(f"{x} {y} {z}" for x, y, z in PART_MESH.vertices)]
    lines += [f"3 {a} {b} {c}" for a, b, c in PART_MESH.faces]
    (folder / "part.off").write_text("\n".join(lines) + "\n")


def read_part(folder, shape, origin=""):
    """Read the one shape of a robot whose URDF is written into a folder."""
    warn_once.cache_clear()
    path = folder / "toy.urdf"
    path.write_text(PART.format(shape=shape, origin=origin))
    return load_urdf(path).links[0].geoms[0].shape


def read_collada(folder, unit, up="Z_UP", scale="1 1 1"):
    """Read the one shape of a robot, from a COLLADA file of some unit."""
    pytest.importorskip("trimesh")
    pytest.importorskip("collada", reason="pycollada is not installed: extra design")
    numbers, faces = (
        " ".join(map(str, array.ravel().tolist()))
        for array in (PART_MESH.vertices, PART_MESH.faces)
    )
    text = COLLADA.format(unit=unit, up=up, numbers=numbers, faces=faces)
    (folder / "part.dae").write_text(text)
    return read_part(folder, f'<mesh filename="part.dae" scale="{scale}"/>')
