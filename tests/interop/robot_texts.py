"""URDF texts of three small robots."""

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
  <link name="column"/>
  <link name="upper">
    <inertial>
      <origin xyz="0.01 0.2 -0.03" rpy="0.3 -0.2 0.5"/>
      <mass value="2.5"/><inertia ixx="0.04" ixy="0.003" ixz="-0.002" iyy="0.05" iyz="0.001" izz="0.03"/>
    </inertial>
  </link>
  <link name="slide">
    <inertial>
      <origin xyz="0 0 0.1"/>
      <mass value="1.2"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.012" iyz="0" izz="0.008"/>
    </inertial>
  </link>
  <link name="camera">
    <inertial>
      <origin xyz="0.02 0 0" rpy="0 0 1.5708"/>
      <mass value="0.4"/><inertia ixx="0.002" ixy="0.0001" ixz="0" iyy="0.001" iyz="0" izz="0.003"/>
    </inertial>
  </link>
  <link name="wrist">
    <inertial>
      <origin xyz="0 0.05 0.02"/>
      <mass value="0.8"/><inertia ixx="0.003" ixy="0" ixz="0.0005" iyy="0.004" iyz="0" izz="0.002"/>
    </inertial>
  </link>
  <link name="finger">
    <inertial>
      <origin xyz="0 0 0.02"/>
      <mass value="0.1"/><inertia ixx="0.0002" ixy="0" ixz="0" iyy="0.0003" iyz="0" izz="0.0001"/>
    </inertial>
  </link>
  <link name="tool0"/>
  <joint name="stand" type="fixed">
    <parent link="base"/><child link="column"/><origin xyz="0 0 0.4" rpy="0 0 0.7"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="column"/><child link="upper"/>
    <origin xyz="0.1 -0.05 0.2" rpy="1.570796326794897 0 0"/><axis xyz="0.2 0.3 0.9"/>
    <limit lower="-2" upper="2.5" effort="80" velocity="3"/><dynamics damping="0.7" friction="0.4"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="upper"/><child link="slide"/>
    <origin xyz="0 0.4 0" rpy="0.4 -1.1 0.2"/><axis xyz="0 -1 0"/>
    <limit lower="-0.1" upper="0.3" effort="200" velocity="1"/><dynamics damping="12"/>
  </joint>
  <joint name="camera_mount" type="fixed">
    <parent link="slide"/><child link="camera"/><origin xyz="0.05 0.02 0.1" rpy="0.2 0.9 -0.4"/>
  </joint>
  <joint name="wrist.roll" type="continuous">
    <parent link="camera"/><child link="wrist"/><origin xyz="0 0 0.12" rpy="0 1.5708 0"/><axis xyz="-1 0 0"/>
  </joint>
  <joint name="grip" type="prismatic">
    <parent link="wrist"/><child link="finger"/><origin xyz="0 0.02 0.1"/><axis xyz="0 1 1"/>
    <limit lower="0" upper="0.05" effort="10" velocity="1"/><mimic joint="wrist.roll" multiplier="-0.02" offset="0.01"/>
  </joint>
  <joint name="tool_mount" type="fixed">
    <parent link="wrist"/><child link="tool0"/><origin xyz="0 0 0.15" rpy="0 0 3.141592653589793"/>
  </joint>
</robot>
"""

WALKER = """<robot name="walker">
  <link name="trunk">
    <inertial>
      <origin xyz="0.03 0 0.05" rpy="0.1 0 0"/>
      <mass value="6"/><inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.2" iyz="-0.02" izz="0.15"/>
    </inertial>
  </link>
  <link name="left"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.003"/></inertial></link>
  <link name="right"><inertial><origin xyz="0 0.01 -0.2"/><mass value="1.1"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.003"/></inertial></link>
  <link name="foot"><inertial><mass value="0.2"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <joint name="hip_l" type="revolute"><parent link="trunk"/><child link="left"/>
    <origin xyz="0 0.1 -0.1"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="30" velocity="5"/></joint>
  <joint name="hip_r" type="revolute"><parent link="trunk"/><child link="right"/>
    <origin xyz="0 -0.1 -0.1"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="30" velocity="5"/></joint>
  <joint name="ankle" type="fixed"><parent link="left"/><child link="foot"/><origin xyz="0.02 0 -0.4"/></joint>
</robot>
"""

CART = """<robot name="cart">
  <link name="floor"/>
  <link name="cart"><inertial><origin xyz="0.1 0 0.2"/><mass value="20"/>
    <inertia ixx="1" ixy="0" ixz="0.1" iyy="1.2" iyz="0" izz="0.8"/></inertial></link>
  <link name="mast"><inertial><origin xyz="0 0 0.5"/><mass value="2"/>
    <inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.01"/></inertial></link>
  <joint name="drive" type="planar"><parent link="floor"/><child link="cart"/>
    <origin xyz="0.3 0.2 0.1" rpy="0.2 0 0.4"/><axis xyz="0 0 1"/></joint>
  <joint name="tilt" type="revolute"><parent link="cart"/><child link="mast"/>
    <origin xyz="0.1 0 0.3"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="30" velocity="5"/></joint>
</robot>
"""

CRANE = """<mujoco model="crane">
  <compiler angle="radian" eulerseq="zyx"/>
  <option gravity="0.2 0 -9.81"/>
  <default>
    <joint damping="0.3" armature="0.02"/>
    <geom contype="0" conaffinity="0" density="500"/>
    <default class="soft"><joint stiffness="40" springref="0.2" damping="1.5"/></default>
  </default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="mast" pos="0.1 0 0.3" euler="0.3 0.2 -0.4" childclass="soft">
      <joint name="slew" axis="0 0 1"/>
      <joint name="luff" axis="0.2 1 0" pos="0.1 0 0.2" ref="0.25" class="main"/>
      <geom name="beam" type="capsule" fromto="0 0 0 0.5 0.1 0.2" size="0.05"/>
      <geom type="box" size="0.1 0.05 0.2" pos="0 0.1 0" quat="1 0.2 0 0" mass="2.5"/>
      <body name="trolley" pos="0.4 0 0.1" axisangle="1 1 0 0.7">
        <joint name="run" type="slide" axis="1 0 0" range="-0.2 0.3" ref="0.05"/>
        <inertial pos="0.01 0.02 0" mass="1.5" fullinertia="0.02 0.03 0.025 0.002 -0.001 0.003"/>
        <frame pos="0 0 -0.1" xyaxes="0 1 0 -1 0 0">
          <body name="load" pos="0 0 -0.2">
            <joint name="swing" type="ball" damping="0.3" armature="0" stiffness="0"/>
            <inertial pos="0 0 -0.15" mass="3" diaginertia="0.04 0.05 0.02" quat="0.9 0.1 0.2 0"/>
          </body>
        </frame>
        <body name="lamp" pos="0 0.1 0" zaxis="1 0 1"><geom type="ellipsoid" size="0.05 0.06 0.08"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="slew_motor" joint="slew" gear="5"/>
    <position name="luff_servo" joint="luff" kp="30" kv="2"/>
    <velocity name="run_drive" joint="run" kv="12"/>
    <general name="run_bias" joint="run" gear="2" gainprm="3" biastype="affine" biasprm="1 -4 -0.5"/>
  </actuator>
</mujoco>
"""

PUCK = """<mujoco model="puck"><worldbody>
  <body name="puck" pos="1 1 1"><freejoint/>
    <geom type="cylinder" size="0.1 0.03" pos="0.02 0 0" contype="0" conaffinity="0"/></body>
</worldbody></mujoco>
"""
