"""A servo whose loop as built hunts by its encoder."""

from casahunt import Friction, Pid, Servo

SERVO = Servo(
    inertia=0.012, motor_gain=4.2, controller=Pid(kp=1, ki=8, kd=0.05),
    friction=Friction(static=0.40, coulomb=0.30, stribeck_velocity=0.05, viscous=0.02),
)  # fmt: skip
