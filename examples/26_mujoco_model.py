"""A MuJoCo model as a robot: the tool of MuJoCo's own simulation reaches a pose that was solved here.

python examples/26_mujoco_model.py    (needs MuJoCo: pip install 'maira-qp[mujoco]')
"""

from importlib.util import find_spec

import numpy as np

import maira_qp as mq

MODEL = """
<mujoco model="arm on a rail">
  <compiler angle="degree"/>
  <default>
    <joint axis="0 1 0" range="-120 120"/>
    <geom type="capsule" size="0.04"/>
    <default class="finger">
      <joint type="slide" axis="0 1 0" range="0 0.04"/><geom type="box" size="0.01 0.01 0.03"/>
    </default>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="cart" pos="0 0 0.4">
      <joint name="rail" type="slide" axis="1 0 0" range="-0.5 0.5"/>
      <geom type="box" size="0.1 0.1 0.05"/>
      <body name="upper" pos="0 0 0.1">
        <joint name="turn" axis="0 0 1"/><joint name="shoulder"/><geom fromto="0 0 0 0 0 0.35"/>
        <body name="fore" pos="0 0 0.4">
          <joint name="elbow"/><geom fromto="0 0 0 0 0 0.25"/>
          <body name="hand" pos="0 0 0.3">
            <joint name="pitch"/><joint name="roll" axis="0 0 1"/><geom type="sphere" size="0.05"/>
            <site name="grip" pos="0 0 0.12"/>
            <body name="left" childclass="finger" pos="0 0.01 0.08"><joint name="left"/><geom/></body>
            <body name="right" childclass="finger" pos="0 -0.01 0.08"><joint name="right" axis="0 -1 0"/><geom/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="stretch" range="-1 1.6"><joint joint="shoulder" coef="1"/><joint joint="elbow" coef="1"/></fixed>
  </tendon>
  <equality><joint joint1="right" joint2="left"/></equality>
  <keyframe><key name="home" qpos="0 0.3 0.5 0.9 0.2 0 0 0"/></keyframe>
</mujoco>
"""


def main() -> None:
    """Solve for a site of the model, and let MuJoCo say where that is."""
    if find_spec("mujoco") is None:
        print("MuJoCo is not installed: pip install 'maira-qp[mujoco]'")
        return
    import mujoco

    robot = mq.Robot.from_mjcf(MODEL, tip="grip")
    print(robot)
    print("states:", ", ".join(robot.states))
    (stretch,) = robot.sum_limits  # the range of the tendon, which every solver keeps
    print(stretch.name, dict(stretch.coefficients), "within", (stretch.lower, stretch.upper))
    solver = mq.Solver(robot, limits=[mq.CollisionLimit()], redundancy=mq.Strict(mq.Posture(robot.state("home"))))
    target = robot.forward([0.2, 0.6, 0.9, 0.7, 0.4, 0.5])
    s = solver.solve(target, q0=robot.state("home"))
    print(s.status, np.round(s.q, 3), f"{1e3 * s.position_error:.1e} mm")

    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    for name, value in zip(robot.joint_names, s.q, strict=True):
        data.joint(name).qpos[:] = value
    mujoco.mj_forward(model, data)
    print(f"MuJoCo has the site {np.linalg.norm(data.site('grip').xpos - target.translation):.1e} m from the target")

    far = mq.Solver(robot, task=mq.PositionTask()).solve(mq.pose([1.5, 0.0, 0.3]), q0=s.q)
    for name, value in zip(robot.joint_names, far.q, strict=True):
        data.joint(name).qpos[:] = value
    mujoco.mj_forward(model, data)
    length = data.tendon("stretch").length.item()
    print(f"toward the floor {far.active_limits} hold it: MuJoCo has the tendon at {length:.3f}")

    hand = mq.Robot.from_mjcf(MODEL, tip=["left", "right"], base="hand")
    print("the fingers, coupled by an equality:", hand.joint_names)


if __name__ == "__main__":
    main()
