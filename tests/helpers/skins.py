"""These helpers write the files of a small skin, and one with the robot it is on."""

from eskin.robot import load_robot
from eskin.skin import build_grid_skin, save_skin

MANIFEST = """\
name: small
patches:
  - {id: left, link: arm, address: 1, rows: 2, columns: 2}
  - {id: right, link: arm, address: 2, rows: 1, columns: 2, kind: shear, units: kPa}
"""
TABLE = """\
id,patch,row,column,x,y,z,nx,ny,nz,area_mm2
0,left,0,0,0,0,0,0,0,1,100
1,left,0,1,0.01,0,0,0,0,1,100
2,left,1,0,0,0.01,0,0,0,1,100
3,right,0,0,0.05,0,0,0,0,1,64
4,right,0,1,0.058,0,0,0,0,1,64
"""
ARM = """\
<robot name="arm">
  <link name="base">
    <collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute">
    <origin xyz="0 0 0.1" rpy="0 0.3 0"/>
    <parent link="base"/>
    <child link="table"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <link name="table">
    <collision>
      <origin xyz="0 0 -0.01"/>
      <geometry>PANEL</geometry>
    </collision>
  </link>
</robot>
"""
BOX_ARM = ARM.replace("PANEL", '<box size="0.2 0.2 0.02"/>')
SKIN = build_grid_skin(4, 4, name="mine", calibrated=True)


def write_files(folder, manifest=MANIFEST, table=TABLE):
    """Write the files of a skin and return their folder."""
    (folder / "skin.yaml").write_text(manifest)
    (folder / "taxels.csv").write_text(table)
    return folder


def write_skin(folder, text=BOX_ARM):
    """Write a skin and its robot, whose own file is deleted; return its folder."""
    urdf = folder / "arm.urdf"
    urdf.write_text(text)
    save_skin(SKIN, folder / "mine", load_robot(urdf))
    urdf.unlink()
    return folder / "mine"
