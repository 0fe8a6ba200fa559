"""Kernels of an LPV sliding-mode observer on plain arrays: affine matrices, trim maps, the implicit unit vector."""

import math

from actuators.block import kernel


@kernel
def affine(stack, rho, out):
    """Fill `out` (rows, cols) with stack[0] + sum rho_i stack[i] [Alwi14] (27)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            value = stack[0, i, j]
            for k in range(rho.size):
                value += rho[k] * stack[k + 1, i, j]
            out[i, j] = value


@kernel
def trim_map(coefficients, exponents, low, high, rho, power, out):
    """Fill `out` with polynomials of normalised rho: out_i = sum_t coefficients[i, t] prod_k z_k^exponents[t, k].

    `power` (n_rho, 4) is scratch for the powers of z = 2 (rho - low) / (high - low) - 1.
    """
    for k in range(rho.size):
        z = 2.0 * (rho[k] - low[k]) / (high[k] - low[k]) - 1.0
        power[k, 0] = 1.0
        for j in range(1, power.shape[1]):
            power[k, j] = power[k, j - 1] * z
    out[:] = 0.0
    for t in range(coefficients.shape[1]):
        term = 1.0
        for k in range(rho.size):
            term *= power[k, int(exponents[t, k])]
        for i in range(out.size):
            out[i] += coefficients[i, t] * term


@kernel
def unit_vector_step(e, b, a22, gain, delta, dt):
    """Advance e' = A22s e - K P_o e / (|P_o e| + delta) + ... by backward Euler, in place.

    A22s = diag(a22) < 0 and P_o = -A22s^-1 / 2 [Alwi14] (16). With b = e + h (everything else) and m = |P_o e|,

        e_i = b_i / (1 - h a_i + h K P_i / (m + delta)),

    one scalar equation in m, solved by Newton from above its root, where the right side's norm is increasing and
    concave. Stops when m moves by less than 1e-12.
    """
    m = 0.0
    for i in range(e.size):
        v = -0.5 / a22[i] * b[i]
        m += v * v
    m = math.sqrt(m)
    for _ in range(60):
        total, slope = 0.0, 0.0
        for i in range(e.size):
            k = -0.5 * dt * gain / a22[i]
            full = (1.0 - dt * a22[i]) * (m + delta) + k
            v = -0.5 / a22[i] * b[i] / full
            total += v * v * (m + delta) * (m + delta)
            slope += v * v * (m + delta) * k / full
        if total == 0.0:
            m = 0.0
            break
        root = math.sqrt(total)
        move = (root - m) / (1.0 - slope / root)
        m = max(m + move, 0.0)
        if math.fabs(move) < 1e-12:
            break
    for i in range(e.size):
        e[i] = b[i] / (1.0 - dt * a22[i] - 0.5 * dt * gain / a22[i] / (m + delta))


@kernel
def held_first_order(a, dt):
    """Return (e^(a h), c0, c1): x+ = e^(a h) x + c0 g_0 + c1 g_1 is exact for x' = a x + g, g linear in time."""
    z = a * dt
    if math.fabs(z) < 1e-4:  # series: the closed form loses digits as z -> 0
        return 1.0 + z * (1.0 + 0.5 * z), dt * (0.5 + z / 3.0), dt * (0.5 + z / 6.0)
    f = math.expm1(z)
    c1 = (f - z) / (z * a)
    return 1.0 + f, f / a - c1, c1
