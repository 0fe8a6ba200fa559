"""Small loops for kernels: matrices of a few rows, in place, without allocation (`@` costs 10 times as much)."""

from actuators.block import kernel

TAYLOR = 8  # terms of the exponential: |A| h <= 1 leaves 1/9! = 3e-6, the actuator's 0.3 leaves 5e-11


@kernel
def congruence(P, Phi, W):
    """Replace P by Phi P Phi^T; P, Phi, W: (n, n), W is scratch."""
    n = P.shape[0]
    for i in range(n):
        for j in range(n):
            s = 0.0
            for k in range(n):
                s += Phi[i, k] * P[k, j]
            W[i, j] = s
    for i in range(n):
        for j in range(i, n):
            s = 0.0
            for k in range(n):
                s += W[i, k] * Phi[j, k]
            P[i, j] = s
            P[j, i] = s


@kernel
def joseph(P, K, j, r):
    """Replace P by (I - K h) P (I - K h)^T + K r K^T, where h is the unit row `j`; P: (n, n), K: (n,). [Lu17] (25)

    P stays symmetric, and positive where K is not the optimal gain.
    """
    n = P.shape[0]
    for a in range(n):  # (I - K h) P: row j is read by all, so it is changed last
        if a != j:
            for b in range(n):
                P[a, b] -= K[a] * P[j, b]
    kj = 1.0 - K[j]
    for b in range(n):
        P[j, b] *= kj
    for a in range(n):  # ... times (I - K h)^T: column j likewise
        c = P[a, j]
        for b in range(n):
            if b != j:
                P[a, b] -= c * K[b]
        P[a, j] = c * kj
    for a in range(n):
        for b in range(a, n):
            s = 0.5 * (P[a, b] + P[b, a]) + K[a] * r * K[b]
            P[a, b] = s
            P[b, a] = s


@kernel
def integral_column(a21, a22, a23, a31, a32, a33, e1, e2, e3, h):
    """Return the column  int_0^h exp(A s) ds e  of A = [[0, 1, 0], [a21, a22, a23], [a31, a32, a33]], by Taylor series.

    One exponential of the augmented matrix gives Phi = I + A Psi and Gamma = Psi G together. [Lu17] (19)-(20)
    """
    v1, v2, v3 = e1 * h, e2 * h, e3 * h
    s1, s2, s3 = v1, v2, v3
    for n in range(2, TAYLOR + 2):
        c = h / n
        v1, v2, v3 = c * v2, c * (a21 * v1 + a22 * v2 + a23 * v3), c * (a31 * v1 + a32 * v2 + a33 * v3)
        s1 += v1
        s2 += v2
        s3 += v3
    return s1, s2, s3
