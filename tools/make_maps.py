"""Write the preset maps of the package `vehicle` from the formulas below: python tools/make_maps.py [FOLDER].

[L] Table 1 gives 50 kW for the engine and for the motor but no maps, so these are models with numbers of our
own, in the form of L. Guzzella, A. Sciarretta, Vehicle Propulsion Systems, 2nd ed., Springer 2007.

Engine, 1.2 l, spark ignition, of the kind built for hybrids (Atkinson cycle, peak efficiency 0.40: with much
less, the fuel of [L] Table 2 is out of reach). With mean effective pressures of work p_me and of fuel p_mf,

    p_me = e(w) p_mf - p_me0(w),     p = 4 pi T / V_d,
    e(w) = 0.465 - 0.040 ((w - 290) / 290)^2,      p_me0(w) = 1.20 bar + 0.50 bar (w / 500)^2,

and more fuel where the spark is retarded against knock and the mixture is enriched, above 0.7 of full load z:

    fuel *= 1 + (0.9 + 1.4 [w - 420]+ / 200) [z - 0.7]+^2.

Motor, permanent magnets: copper, hysteresis, eddy-current and windage losses

    loss = 0.12 T^2 + 0.6 w + 0.8e-3 w^2 + 3e-6 w^3      (W, with T in Nm and w in rad/s).
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parents[1] / "vehicle" / "presets" / "maps"

DISPLACEMENT_m3 = 1.2e-3
LOWER_HEATING_VALUE_Jpkg = 43.2e6
ENGINE_SPEED_radps = np.append(np.arange(80.0, 621.0, 20.0), 630.0)
ENGINE_TORQUE_Nm = np.arange(0.0, 111.0, 5.0)

MOTOR_POWER_W = 50e3
MOTOR_TORQUE_LIMIT_Nm = 250.0
MOTOR_SPEED_radps = np.arange(0.0, 801.0, 20.0)
MOTOR_TORQUE_Nm = np.arange(-MOTOR_TORQUE_LIMIT_Nm, MOTOR_TORQUE_LIMIT_Nm + 1.0, 10.0)


def engine_max_torque_Nm(speed_radps: FloatArray) -> FloatArray:
    """Full-load torque: a parabola with 106 Nm at 365 rad/s that gives 50 kW at 550 rad/s."""
    return 106.0 * (1.0 - ((speed_radps - 365.0) / 491.0) ** 2)


def engine_fuel_kgps(speed_radps: FloatArray, torque_Nm: FloatArray) -> FloatArray:
    """Fuel rate of the Willans model in the module's docstring."""
    slope = 0.465 - 0.040 * ((speed_radps - 290.0) / 290.0) ** 2
    loss_Pa = 1.20e5 + 0.50e5 * (speed_radps / 500.0) ** 2
    loss_Nm = loss_Pa * DISPLACEMENT_m3 / (4.0 * np.pi)
    heat_W = (torque_Nm + loss_Nm) / slope * speed_radps
    load = torque_Nm / engine_max_torque_Nm(speed_radps)
    severity = 0.9 + 1.4 * np.maximum(speed_radps - 420.0, 0.0) / 200.0
    rich = 1.0 + severity * np.maximum(load - 0.7, 0.0) ** 2
    return heat_W * rich / LOWER_HEATING_VALUE_Jpkg


def motor_max_torque_Nm(speed_radps: FloatArray) -> FloatArray:
    """Constant torque, then constant power."""
    corner = MOTOR_POWER_W / MOTOR_TORQUE_LIMIT_Nm
    return MOTOR_POWER_W / np.maximum(speed_radps, corner)


def motor_loss_W(speed_radps: FloatArray, torque_Nm: FloatArray) -> FloatArray:
    """Losses of the model in the module's docstring."""
    iron = 0.6 * speed_radps + 0.8e-3 * speed_radps**2
    return 0.12 * torque_Nm**2 + iron + 3e-6 * speed_radps**3


def grid_text(
    title: str, header: str, speed_radps: FloatArray, torque_Nm: FloatArray, values: FloatArray, unit: float
) -> str:
    """CSV in long form, one row per grid point, with values rounded to a unit's multiples."""
    rows = [
        f"{w:g},{t:g},{round(v / unit) * unit:.6g}"
        for w, line in zip(speed_radps, values, strict=True)
        for t, v in zip(torque_Nm, line, strict=True)
    ]
    return "\n".join([f"# {title}; made by tools/make_maps.py", header, *rows, ""])


def files() -> dict[str, str]:
    """Text of each map file by name."""
    w, t = np.meshgrid(ENGINE_SPEED_radps, ENGINE_TORQUE_Nm, indexing="ij")
    fuel = grid_text(
        "50 kW spark-ignition engine, fuel rate, Willans model",
        "speed_radps,torque_Nm,fuel_gps",
        ENGINE_SPEED_radps,
        ENGINE_TORQUE_Nm,
        1e3 * engine_fuel_kgps(w, t),
        1e-5,
    )
    w, t = np.meshgrid(MOTOR_SPEED_radps, MOTOR_TORQUE_Nm, indexing="ij")
    loss = grid_text(
        "50 kW permanent-magnet machine, losses, analytic model",
        "speed_radps,torque_Nm,loss_W",
        MOTOR_SPEED_radps,
        MOTOR_TORQUE_Nm,
        motor_loss_W(w, t),
        1e-2,
    )
    engine_limit = [f"{v:g},{engine_max_torque_Nm(v):.2f}" for v in ENGINE_SPEED_radps]
    motor_limit = [f"{v:g},{m:.2f},{-m:.2f}" for v in MOTOR_SPEED_radps for m in [motor_max_torque_Nm(v)]]
    return {
        "engine_50kW_fuel.csv": fuel,
        "engine_50kW_limit.csv": "\n".join(
            [
                "# 50 kW spark-ignition engine, full load; made by tools/make_maps.py",
                "speed_radps,max_torque_Nm",
                *engine_limit,
                "",
            ]
        ),
        "motor_50kW_loss.csv": loss,
        "motor_50kW_limit.csv": "\n".join(
            [
                "# 50 kW permanent-magnet machine, limits; made by tools/make_maps.py",
                "speed_radps,max_torque_Nm,min_torque_Nm",
                *motor_limit,
                "",
            ]
        ),
    }


def main(folder: Path) -> None:
    """Write every map into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files().items():
        (folder / name).write_text(text, encoding="utf-8")
        print(folder / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
