"""
Why gain alone is a poor cure
=============================

"It hunts? Raise the gain." Above a certain gain the continuous loop does come to rest. This page follows that advice to
its end, with a small drive: what the gain must be, what it must be when friction is known to ten per cent, what it
costs, and what the drive as built does with it, which has a sample time and an encoder.
"""

import matplotlib.pyplot as plt
import numpy as np

import casahunt
from casahunt import Drive, Friction, Pid, Servo, Uncertainty

friction = Friction(static=0.40, coulomb=0.30, stribeck_velocity=0.05, viscous=0.02)
pid = Pid(kp=1, ki=8, kd=0.05)
servo = Servo(inertia=0.012, motor_gain=4.2, controller=pid, friction=friction)
drive = Drive(sample_time=1e-3, encoder=2000)  # 1 ms, 2000 counts per revolution

present = 1.0  # V/rad
orbit = casahunt.find_orbit(servo, "switch", present)
print(f"at {present:g} V/rad the continuous loop hunts")
print(f"with {orbit.amplitude:.4f} rad, {1 / orbit.period:.3f} Hz")

# %%
# The gain that would do
# ----------------------
# Hunting is possible up to the *fold* gain. It hangs on friction, of which little is known: a data sheet gives a
# number, and cold grease, wear and load change it. The worst servo within five or ten per cent decides.

fold = casahunt.find_fold(servo, "switch")
known = np.array([0, 0.02, 0.05, 0.1])
uncertain = ("static", "coulomb", "stribeck_velocity")


def within(part):
    known = {f"friction.{name}": getattr(friction, name) for name in uncertain}
    return Uncertainty({name: ((1 - part) * q, (1 + part) * q) for name, q in known.items()})


worst = [casahunt.worst_corner(servo, "switch", within(part)) for part in known[1:]]
gains = np.array([fold.gain, *(each.gain for each in worst)])
labels = ["exactly", "to 2 %", "to 5 %", "to 10 %"]
for label, gain in zip(labels, gains, strict=True):
    print(f"friction known {label:8} hunting is possible up to {gain:.2f} V/rad")

figure, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
ax.bar(labels, gains, color="tab:blue")
ax.axhline(present, color="tab:red", label="today's gain")
ax.set(xlabel="friction is known", ylabel="hunting possible up to [V/rad]")
ax.legend()

# %%
# What it costs
# -------------
# A tenth above each of these. A step of one radian asks for that gain's torque at once. The phase margin looks good,
# but the loop is faster, and the delay that it bears is shorter. And the derivative turns each count of the encoder
# into a kick of torque, K cm (kp + kd/T) q, many times what friction holds.

kick = drive.count * servo.motor_gain * (pid.kp + pid.kd / drive.sample_time)
print("  gain   torque of 1 rad   bears a delay of   one count kicks with")
for gain in (present, *(1.1 * gains)):
    loop = casahunt.margins(servo, gain, delay=drive.sample_time / 2)
    bears = np.radians(loop.phase_margin) / loop.frequency
    torque = servo.torque_gains(gain)[0]
    print(f"{gain:6.2f}{torque:12.1f} N m{1e3 * bears:15.1f} ms{kick * gain:17.2f} N m")
print(f"static friction holds {friction.static:g} N m")

# %%
# And it still hunts
# ------------------
# The set point, 1 rad, lies between the counts 318 and 319. The nearer one is read as an error of a third of a count,
# the other one of two thirds; none is read as zero. So the integral never stands still, and breaks the servo away
# again and again, at any gain. The more gain, the more often, and with more torque.

gains_tried = (present, 1.1 * gains[0], 1.1 * gains[-1])
motions = {g: casahunt.simulate_sampled(servo, g, drive, time=60.0) for g in gains_tried}
figure, axes = plt.subplots(4, 1, sharex=True, figsize=(6.4, 7), layout="constrained")
for ax, (gain, motion) in zip(axes, motions.items(), strict=False):
    late = motion.times > 45
    stops, torque = int((motion.stops > 45).sum()), abs(motion.torque[late[:-1]]).max()
    print(f"K = {gain:.2f}: {motion.verdict.kind}, {stops} stops in 15 s, {torque:.2f} N m")
    ax.plot(motion.times[late], motion.states[0][late] / drive.count, linewidth=0.8)
    ax.set(ylabel="counts", title=f"off the set point at K = {gain:.2f} V/rad")
axes[3].axhspan(-friction.static, friction.static, color="0.85")
axes[3].plot(motion.times[late][:-1], motion.torque[late[:-1]], "tab:red", linewidth=0.6)
axes[3].set(xlabel="time [s]", ylabel="N m", title="its torque; grey: what friction holds")

# %%
# What does end it
# ----------------
# An integrator that takes no notice of small errors, or one that forgets, keeps today's gain and today's torque. The
# price is an error at rest, which the table names. Each is sized here for the worst servo with friction known to ten
# per cent; the dead band and the leak come to rest in the drive as built, too. That the gain leaves no error is true
# of the continuous loop alone.

names = ["dead band", "shifted dead band", "leak", "gain"]
table = casahunt.remedies(servo, "switch", present, only=names, uncertainty=within(0.1))
for row in table.remedies:
    size, error = f"{row.recommended:.4g} {row.unit}", row.recommended_rest_error
    price = f"torque {row.peak_torque:4.1f} N m, error at rest {error:.4f} rad"
    print(f"{row.name:18} {size:12} {price}")

sizes = {row.name: row.recommended for row in table.remedies}
cured = Drive(sample_time=1e-3, encoder=2000, dead_band=sizes["dead band"])
forgets = Drive(sample_time=1e-3, encoder=2000, leak=sizes["leak"])
set_points = 1.0 + drive.count * np.array([0, 0.25, 0.5, 0.75])  # between two counts
rests = {}
for name, each in {"dead band": cured, "leak": forgets}.items():
    ends = [
        casahunt.simulate_sampled(servo, present, each, time=30.0, set_point=float(at))
        for at in set_points
    ]
    rests[name] = [motion.verdict.kind for motion in ends]
    print(f"{name} in the drive as built, four set points: {', '.join(rests[name])}")

# %%
# So ask first what error at rest the machine may have. Where it may have none, the gain is not the answer either:
# half a count of dead band is needed besides, and takes away the last hunting at that gain.

steep = 1.1 * gains[-1]
half_a_count = Drive(sample_time=1e-3, encoder=2000, dead_band=0.51 * drive.count)
still = casahunt.simulate_sampled(servo, steep, half_a_count, time=30.0)
print(f"K = {steep:.2f} with half a count of dead band: {still.verdict.kind}")

# %%
# The numbers from outside: folds by Taylor series, the worst servo's too; the steps of the torque, at least that of
# one count; and a rest within static friction on a reading that is not integrated, which lasts for ever.

from problems import taylor

gain, _ = taylor.switch_fold(servo, fold.gain, fold.orbit.amplitude)
assert abs(fold.gain / gain - 1) < 1e-6 and gains[-1] > 1.9 * gains[0]
for each in worst:
    gain, _ = taylor.switch_fold(each.servo, each.gain, each.fold.orbit.amplitude)
    assert abs(each.gain / gain - 1) < 1e-6
assert all(motion.verdict.kind == "hunting" for motion in motions.values())
for gain, motion in motions.items():
    assert np.ptp(motion.torque[motion.times[:-1] > 45]) > kick * gain > friction.static
assert {verdict for verdicts in rests.values() for verdict in verdicts} == {"at rest"} == {still.verdict.kind}
assert abs(still.torque[-1]) <= friction.static and abs(still.states[0, -1]) < 1.01 * drive.count
