"""Plain numpy twins of the vehicle kernels, written from the equations without regard to speed."""

import numpy as np

GRAVITY = 9.81


def body_acceleration(vehicle, state, road, ax, ay, drag_N):
    """Newton and Euler for the body on its struts: mass matrix times accelerations is forces and moments."""
    v = vehicle
    a, b, left, right = v.geometry.lengths_m
    x, y = np.array([-a, -a, b, b]), np.array([left, -right, left, -right])
    z, rate = state[:7], state[7:]
    squeeze = z[3:] - (z[0] + x * z[1] + y * z[2])
    speed = rate[3:] - (rate[0] + x * rate[1] + y * rate[2])
    static = v.static_N
    volume = np.maximum(1.0 - squeeze * v.spring_Npm / (v.gas_exponent * static), 0.15)
    force = static * (volume**-v.gas_exponent - 1.0)
    force = force + np.where(speed > 0.0, v.bump_Nspm, v.rebound_Nspm) * speed
    tyre = np.maximum(v.tyre_Npm * (road - z[3:]), -static - v.unsprung_kg * GRAVITY)
    # Unknown are the accelerations and the horizontal forces at pitch and roll centre.
    h_p, h_r, m = v.cg_over_pitch_centre_m, v.cg_over_roll_centre_m, v.mass_kg
    matrix = np.zeros((5, 5))
    matrix[0, 0] = m
    matrix[1, 1], matrix[1, 3] = v.pitch_inertia_kgm2, h_p
    matrix[2, 2], matrix[2, 4] = v.roll_inertia_kgm2, -h_r
    matrix[3, 3], matrix[3, 1] = 1.0, -m * h_p
    matrix[4, 4], matrix[4, 2] = 1.0, m * h_r
    right_side = [
        force.sum(),
        x @ force - v.drag_over_cg_m * drag_N,
        y @ force,
        m * (ax - GRAVITY * z[1]) + drag_N,
        m * (ay + GRAVITY * z[2]),
    ]
    found = np.linalg.solve(matrix, right_side)
    return force, found, np.concatenate([rate, found[:3], (tyre - force) / v.unsprung_kg])


def ride_over(vehicle, road, ax, ay, drag_N, step_s):
    """Strut forces and (heave, pitch, roll, A_x, A_y) at every step."""
    state, forces, motion = np.zeros(14), [], []
    for k in range(len(road)):
        force, found, slope = body_acceleration(vehicle, state, road[k], ax[k], ay[k], drag_N[k])
        forces.append(vehicle.static_N + force)
        felt = (found[3] - drag_N[k]) / vehicle.mass_kg, found[4] / vehicle.mass_kg
        motion.append([*found[:3], *felt])
        if k + 1 == len(road):
            break

        def rate(at, s, k=k):
            mixed = ((1.0 - at) * u[k] + at * u[k + 1] for u in (road, ax, ay, drag_N))
            return body_acceleration(vehicle, s, *mixed)[2]

        k1 = slope
        k2 = rate(0.5, state + 0.5 * step_s * k1)
        k3 = rate(0.5, state + 0.5 * step_s * k2)
        k4 = rate(1.0, state + step_s * k3)
        state = state + step_s / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return np.array(forces), np.array(motion)


def ride(inputs, p):
    """[M] eqs 31-33; rows of parameters."""
    total, nose, side, braking, ay = inputs
    m, pitch, roll, h = p.T
    return np.column_stack([total / m, (nose + m * h * braking) / pitch, (side + m * h * ay) / roll])


def load_transfer(inputs, p, wheelbase, track):
    """[M] eqs 35-38, letter by letter; the last parameter is h_p C."""
    ax, ay, az, square = inputs[0] / GRAVITY, inputs[1] / GRAVITY, inputs[2], inputs[3]
    m, a, left, h_r, h_p, moment = p.T
    c = moment / h_p
    b, r = wheelbase - a, track - left
    share, air = m * az / (track * wheelbase), h_p * square * c / (track * wheelbase)
    return np.column_stack(
        [
            share * (b * r - ay * b * h_r - ax * r * h_p) - r * air,
            share * (b * left + ay * b * h_r - ax * left * h_p) - left * air,
            share * (a * r - ay * a * h_r + ax * r * h_p) + r * air,
            share * (a * left + ay * a * h_r + ax * left * h_p) + left * air,
        ]
    )


def corner_transfer(inputs, p, wheelbase, track):
    """[M] eqs 39 and 48-51, letter by letter; the last parameter is h_p C."""
    ax, ay, az, square = inputs[0] / GRAVITY, inputs[1] / GRAVITY, inputs[2:6], inputs[6]
    pitch, roll = inputs[7], inputs[8]
    fl, fr, rl, rr, h_r, h_p, moment = p.T
    c = moment / h_p
    m = fl + fr + rl + rr
    a, left = wheelbase * (rl + rr) / m, track * (fr + rr) / m
    b, r = wheelbase - a, track - left
    z = 0.25 * (az.sum() + 2.0 * (r - left) * roll + 2.0 * (a - b) * pitch)
    air = h_p * square * c / wheelbase
    return np.column_stack(
        [
            fl * az[0]
            - (fl + fr) * z / track * ay * h_r
            - (fl + rl) * z / wheelbase * ax * h_p
            - air * (fl + rl) / m,
            fr * az[1]
            + (fl + fr) * z / track * ay * h_r
            - (fr + rr) * z / wheelbase * ax * h_p
            - air * (fr + rr) / m,
            rl * az[2]
            - (rl + rr) * z / track * ay * h_r
            + (fl + rl) * z / wheelbase * ax * h_p
            + air * (fl + rl) / m,
            rr * az[3]
            + (rl + rr) * z / track * ay * h_r
            + (fr + rr) * z / wheelbase * ax * h_p
            + air * (fr + rr) / m,
        ]
    )


def unscented(model, start, variance, lower, noise, inputs, outputs):
    """Unscented filter of Julier and Uhlmann with kappa = 3 - n; means and covariances after each sample."""
    n = start.size
    weight = np.full(2 * n + 1, 1.0 / 6.0)
    weight[0] = (3.0 - n) / 3.0
    spread_weight = weight + np.eye(2 * n + 1)[0] * 2.0
    x, p, means, covariances = start.copy(), np.diag(variance), [], []
    for u, z in zip(inputs, outputs, strict=True):
        root = np.sqrt(3.0) * np.linalg.cholesky(p)
        points = np.maximum(np.vstack([x, x + root.T, x - root.T]), lower)
        values = model(u, points)
        mean = weight @ values
        off, moved = values - mean, points - x
        total = (spread_weight[:, None] * off).T @ off + noise
        gain = (spread_weight[:, None] * moved).T @ off @ np.linalg.inv(total)
        x, p = x + gain @ (z - mean), p - gain @ total @ gain.T
        p = 0.5 * (p + p.T)
        means.append(x)
        covariances.append(p)
    return np.array(means), np.array(covariances)
