"""A small arm of six joints as an MJCF file, parts of which a test replaces."""

from __future__ import annotations

from sim.world.scene.arm import ArmModel

ARM = """<mujoco model="six"><compiler angle="degree" autolimits="true"/>{head}
<default><geom type="capsule" size="0.03" mass="1"/></default>
<worldbody>{world}<body name="post"><geom fromto="0 0 0.05 0 0 0.35"/>
 <body name="shoulder" pos="0 0 0.42"><joint name="turn" axis="0 0 1" range="-170 170"/>
  <joint name="lift" axis="0 1 0" range="-120 120"/><geom fromto="0.02 0 0 0.38 0 0"/>
  <body name="elbow" pos="0.45 0 0"><joint name="bend" axis="0 1 0" range="-150 150"/><geom fromto="0.02 0 0 0.33 0 0"/>
   <body name="wrist" pos="0.4 0 0"><joint name="roll" axis="1 0 0" {roll}/>
    <joint name="nod" axis="0 1 0" range="-120 120"/><geom type="sphere" size="0.025"/>
    <body name="hand" pos="0.03 0 0"><joint name="spin" axis="1 0 0" range="-170 170"/><geom type="sphere" size="0.02"/>
     {flange}</body></body></body></body></body></worldbody>{extra}</mujoco>"""
FLANGE = '<site name="flange" quat="0.7071068 0 0.7071068 0"/>'
MIDDLE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
BENT = [0.0, -0.5, 1.5, 0.0, 1.0, 0.0]
KEY = '<key name="home" qpos="0 -0.5 1.5 0 1 0" {}/>'


def arm(tmp_path, *, flange_name=None, name="arm.xml", **parts) -> ArmModel:
    path = tmp_path / name
    given = {"head": "", "world": "", "roll": 'range="-170 170"', "flange": FLANGE, "extra": ""}
    path.write_text(ARM.format(**(given | parts)))
    return ArmModel(path=path, flange=flange_name)
