"""Small loops for kernels: matrices of four rows, in place, without allocation (`@` costs 10 times as much)."""

from actuators.block import kernel

N = 4  # rows: a number that the compiler knows, so that it unrolls
TAYLOR = 8  # terms of the exponential: |A| h <= 1 leaves 1/9! = 3e-6, the actuator's 0.3 leaves 5e-11


@kernel
def diagonal(P, variances):
    """Write the diagonal matrix of `variances` (N,) into P (N, N)."""
    for i in range(N):
        for j in range(N):
            P[i, j] = variances[i] if i == j else 0.0


@kernel
def congruence(P, Phi, W):
    """Replace P by Phi P Phi^T; P, Phi, W: (N, N), W is scratch."""
    for i in range(N):
        for j in range(N):
            s = 0.0
            for k in range(N):
                s += Phi[i, k] * P[k, j]
            W[i, j] = s
    for i in range(N):
        for j in range(i, N):
            s = 0.0
            for k in range(N):
                s += W[i, k] * Phi[j, k]
            P[i, j] = s
            P[j, i] = s


@kernel
def joseph(P, K, j, r):
    """Replace P by (I - K h) P (I - K h)^T + K r K^T, where h is the unit row `j`; P: (N, N), K: (N,). [Lu17] (25)

    P stays symmetric, and positive where K is not the optimal gain.
    """
    for a in range(N):  # (I - K h) P: row j is read by all, so it is changed last
        if a != j:
            for b in range(N):
                P[a, b] -= K[a] * P[j, b]
    kj = 1.0 - K[j]
    for b in range(N):
        P[j, b] *= kj
    for a in range(N):  # ... times (I - K h)^T: column j likewise
        c = P[a, j]
        for b in range(N):
            if b != j:
                P[a, b] -= c * K[b]
        P[a, j] = c * kj
    for a in range(N):
        for b in range(a, N):
            s = 0.5 * (P[a, b] + P[b, a]) + K[a] * r * K[b]
            P[a, b] = s
            P[b, a] = s


@kernel
def integral(a21, a22, a23, a31, a32, a33, h):
    """Return int_0^h exp(A s) ds of A = [[0, 1, 0], [a21, a22, a23], [a31, a32, a33]] by Taylor series, by columns.

    One exponential of the augmented matrix gives Phi = I + A Psi and Gamma = Psi G together. [Lu17] (19)-(20) The three
    columns k, l, m are summed side by side: each waits for its own last term only.
    """
    p1, p2, p3 = h, 0.0, 0.0
    q1, q2, q3 = 0.0, h, 0.0
    r1, r2, r3 = 0.0, 0.0, h
    k1, k2, k3, l1, l2, l3, m1, m2, m3 = p1, p2, p3, q1, q2, q3, r1, r2, r3
    for n in range(2, TAYLOR + 2):
        c = h / n
        p1, p2, p3 = c * p2, c * (a21 * p1 + a22 * p2 + a23 * p3), c * (a31 * p1 + a32 * p2 + a33 * p3)
        q1, q2, q3 = c * q2, c * (a21 * q1 + a22 * q2 + a23 * q3), c * (a31 * q1 + a32 * q2 + a33 * q3)
        r1, r2, r3 = c * r2, c * (a21 * r1 + a22 * r2 + a23 * r3), c * (a31 * r1 + a32 * r2 + a33 * r3)
        k1, k2, k3 = k1 + p1, k2 + p2, k3 + p3
        l1, l2, l3 = l1 + q1, l2 + q2, l3 + q3
        m1, m2, m3 = m1 + r1, m2 + r2, m3 + r3
    return k1, k2, k3, l1, l2, l3, m1, m2, m3
