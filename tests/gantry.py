"""An arm of a user's own: a gantry with a turning wrist."""

GANTRY = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom type="cylinder" size="0.05 0.02"/>
    <body name="rail" pos="0 0 1.2">
      <inertial mass="3" pos="0 0 0" diaginertia="0.02 0.02 0.02"/>
      <joint name="x" type="slide" axis="1 0 0" range="-0.2 0.9"/>
      <body name="carriage">
        <joint name="y" type="slide" axis="0 1 0" range="-0.6 0.6"/>
        <geom type="box" size="0.05 0.05 0.02" mass="1"/>
        <body name="mast">
          <joint name="z" type="slide" axis="0 0 1" range="-1.1 0"/>
          <geom type="capsule" fromto="0 0 -0.04 0 0 0" size="0.02" mass="0.5"/>
          <body name="wrist" pos="0 0 -0.06" quat="0 1 0 0">
            <joint name="turn" axis="0 0 1" range="-6 6"/>
            <geom type="capsule" fromto="0 0 -0.02 0 0 0.02" size="0.02" mass="0.2"/>
            <site name="attachment_site" pos="0 0 0.02"/>
            <body name="finger" pos="0.05 0 0">
              <joint name="grip" type="slide" axis="1 0 0" range="0 0.02"/>
              <geom type="box" size="0.005 0.005 0.005" mass="0.01"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="z" forcerange="-300 300"/></actuator>
  <keyframe><key qpos="0.4 0 -0.5 0 0"/></keyframe>
</mujoco>
"""
