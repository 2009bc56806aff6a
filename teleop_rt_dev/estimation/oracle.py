"""Each solver of the report's chapter 3 in plain Python, written from the equations alone.

Nothing here comes from the package; no numpy either. A solver is a class with `theta` and
`step(phi, y)`.
"""

from __future__ import annotations

from collections.abc import Sequence

Row = Sequence[float]
Rows = Sequence[Row]


def dot(a: Row, b: Row) -> float:
    return sum(p * q for p, q in zip(a, b, strict=True))


def times(A: Rows, x: Row) -> list[float]:
    return [dot(row, x) for row in A]


def eye(n: int, value: float = 1.0) -> list[list[float]]:
    return [[value if i == j else 0.0 for j in range(n)] for i in range(n)]


def matmul(A: Rows, B: Rows) -> list[list[float]]:
    columns = list(zip(*B, strict=True))
    return [[dot(row, column) for column in columns] for row in A]


class Rls:
    """Equations 3.2 to 3.5."""

    def __init__(self, n: int, prior: float = 1e6, forgetting: float = 1.0) -> None:
        self.n = n
        self.theta = [0.0] * n
        self.P = eye(n, prior)
        self.forgetting = forgetting

    def gain_and_covariance(self, phi: Row) -> list[float]:
        u = times(self.P, phi)
        spread = self.forgetting + dot(phi, u)
        L = [value / spread for value in u]
        self.P = [
            [(self.P[i][j] - L[i] * u[j]) / self.forgetting for j in range(self.n)]
            for i in range(self.n)
        ]
        return L

    def step(self, phi: Row, y: float) -> float:
        e = y - dot(phi, self.theta)
        L = self.gain_and_covariance(phi)
        self.theta = [t + gain * e for t, gain in zip(self.theta, L, strict=True)]
        return e


class Sprls(Rls):
    """Equation 3.6."""

    def __init__(
        self, n: int, beta: float, gamma: float, prior: float = 1e6, forgetting: float = 1.0
    ) -> None:
        super().__init__(n, prior, forgetting)
        self.beta, self.gamma = beta, gamma

    def nearest(self, e: float) -> int:
        return round(self.gamma * e * e)

    def step(self, phi: Row, y: float) -> float:
        e = super().step(phi, y)
        amount = self.beta * self.nearest(e)
        for i in range(self.n):
            self.P[i][i] += amount
        return e


class NiSprls(Sprls):
    """Equations 3.7 and 3.8, the sign in 3.8 corrected to (1 - rho)."""

    def __init__(
        self,
        n: int,
        beta: float,
        gamma: float,
        variance: float,
        rho: float,
        prior: float = 1e6,
        forgetting: float = 1.0,
    ) -> None:
        super().__init__(n, beta, gamma, prior, forgetting)
        self.variance, self.rho, self.mean_square = variance, rho, 0.0

    def nearest(self, e: float) -> int:
        self.mean_square = self.rho * self.mean_square + (1.0 - self.rho) * e * e
        return round(self.gamma * abs(self.mean_square - self.variance) / self.variance)


class GnVffRls(Rls):
    """Equations 3.9 to 3.13, with M phi e for the report's M theta e."""

    def __init__(
        self,
        n: int,
        alpha: float,
        low: float,
        high: float,
        delta: float,
        floor: float,
        prior: float = 1e6,
    ) -> None:
        super().__init__(n, prior, high)
        self.alpha, self.low, self.high = alpha, low, high
        self.delta, self.floor = delta, floor
        self.psi = [0.0] * n
        self.M = eye(n, 0.0)

    def step(self, phi: Row, y: float) -> float:
        n = self.n
        e = y - dot(phi, self.theta)
        g = dot(self.psi, phi)
        self.delta = max((1.0 - self.alpha) * self.delta + self.alpha * g * g, self.floor)
        step = self.forgetting + self.alpha * g * e / self.delta
        self.forgetting = min(max(step, self.low), self.high)
        L = self.gain_and_covariance(phi)
        self.theta = [t + gain * e for t, gain in zip(self.theta, L, strict=True)]
        left = [[(i == j) - L[i] * phi[j] for j in range(n)] for i in range(n)]
        right = [[(i == j) - phi[i] * L[j] for j in range(n)] for i in range(n)]
        inner = matmul(matmul(left, self.M), right)
        self.M = [
            [(inner[i][j] + L[i] * L[j] - self.P[i][j]) / self.forgetting for j in range(n)]
            for i in range(n)
        ]
        pushed = times(self.M, phi)
        kept = times(left, self.psi)
        self.psi = [a + b * e for a, b in zip(kept, pushed, strict=True)]
        return e


class Iec:
    """Equation 3.14, solved by elimination with pivoting; None while singular."""

    def __init__(self, n: int, forgetting: float = 1.0) -> None:
        self.n, self.forgetting = n, forgetting
        self.theta = [0.0] * n
        self.R = eye(n, 0.0)
        self.r = [0.0] * n

    def step(self, phi: Row, y: float) -> None:
        n = self.n
        for i in range(n):
            self.r[i] = self.forgetting * self.r[i] + phi[i] * y
            for j in range(n):
                self.R[i][j] = self.forgetting * self.R[i][j] + phi[i] * phi[j]
        solution = solve([row[:] for row in self.R], self.r[:])
        if solution is not None:
            self.theta = solution


def solve(A: list[list[float]], b: list[float]) -> list[float] | None:
    n = len(b)
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(A[i][k]))
        if abs(A[pivot][k]) < 1e-300:
            return None
        A[k], A[pivot] = A[pivot], A[k]
        b[k], b[pivot] = b[pivot], b[k]
        for i in range(k + 1, n):
            factor = A[i][k] / A[k][k]
            for j in range(k, n):
                A[i][j] -= factor * A[k][j]
            b[i] -= factor * b[k]
    x = [0.0] * n
    for i in reversed(range(n)):
        x[i] = (b[i] - sum(A[i][j] * x[j] for j in range(i + 1, n))) / A[i][i]
    return x
