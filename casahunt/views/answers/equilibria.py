"""What `casahunt equilibria` says of where the servo can stand still."""

from __future__ import annotations

from collections.abc import Iterator

from ...servo.equilibria import PROVES, Equilibria
from .answer import Answer, angle, item, short


def equilibria_answer(found: Equilibria) -> Answer:
    """What is said of the equilibria at a gain."""
    plain = [
        f"{found.model} servo at gain {found.gain:.10g} V/rad: it can stand still for ever at the set point alone",
        item("there", f"with any integral of the error up to {short(found.integral_limit)} rad s"),
        item("stuck beside it", f"friction alone holds it up to {angle(found.position_limit)} away, but the integral "
                                "grows until it breaks away"),
        item("does it hunt?", "this does not say: casahunt orbit does"),
    ]  # fmt: skip
    return Answer(plain, _details(found))


def _details(found: Equilibria) -> Iterator[str]:
    yield item("state", "x1 position from the set point, x2 velocity, x3 integral of x1")
    yield item("equilibria", f"x1 = x2 = 0, |x3| <= Fs/ki = {found.integral_limit:.10g} rad s")
    if found.model == "switch":
        limit = f"at x3 = 0, |x1| <= {found.position_limit:.10g} rad"
        yield item("stick region", f"x2 = 0, |kp x1 + ki x3| <= Fs: {limit}")
        yield item("elsewhere in it", "the integral grows until the servo breaks away, after a finite time")
        yield item("linearising", "has no answer: while it sticks every eigenvalue is zero, for exact friction")
        return
    yield item("bristle", f"z = -ki x3/sigma0, |z| <= Fs/sigma0 = {found.bristle_limit:.10g} rad")
    yield item(
        "linearising",
        f"friction has a kink at x2 = 0: the generalised Jacobian has one eigenvalue 0; of the others, over "
        f"{found.q.size} x {found.alpha.size} of its members, the largest real part is {found.largest.max():.8g} 1/s",
    )
    for name, text, sides, unit, says in (
        ("sharp", "kd + sigma2 > J ki/kp", found.sharp, "N m s/rad", "necessary and sufficient"),
        ("simple", "sigma2/J > ki/kp", found.simple, "1/s", "sufficient, and for all K > 0"),
    ):
        than, holds = (">", "it holds") if sides[0] > sides[1] else ("<=", "it does not hold")
        yield item(
            f"{name} condition",
            f"{text}, {says} for all members to be stable but for the zero: {sides[0]:.8g} {than} {sides[1]:.8g} "
            f"{unit}, {holds}",
        )
    if found.threshold:
        least = f"1 - (2 alpha - 1) sigma0 z/Fs < {found.threshold:.4g}, at the ends of the segment"
        yield item("unstable members", least)
    for sentence in PROVES.split(". "):
        about, _, text = sentence.rstrip(".").partition(": ")
        yield item("not proved" if "not" in about else "proved", text)
