"""Compiled kernel of a grey-box model: windows of a recording with their derivatives.

The equations and their Jacobians become C, as those of a component do. The kernel steps the states
by Runge-Kutta of fourth order, and with them their derivatives by the initial state and by the
parameters (the variational equation, stage by stage), so that these are those of the steps and not
of the exact solution.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, generated_sources, load_library
from uuvsim_cosim.models.declaration.interruption import interruptible
from uuvsim_cosim.studies.identification.fitted_model import GreyBox

__all__ = ["Windows"]

Array = NDArray[np.float64]
_DRIVER = """
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum {{ NX = {n_x}, NW = {n_w}, NP = {n_p}, NS = NX + NP, NY = 12 }};

typedef struct {{ casadi_int *iw; double *w; double A[NX * NX], B[NX * NP + 1]; }} scratch;

static void rates(const double *x, const double *w, const double *theta, const double S[NX][NS],
                  double *f, double dS[NX][NS], scratch *s) {{
    const double *arg[{n_arg}] = {{x, w, theta}};
    double *res[{n_res}] = {{f, s->A, s->B}};
    rhs(arg, res, s->iw, s->w, 0);
    for (int i = 0; i < NX; i++) {{
        double *row = dS[i];
        memset(row, 0, NX * sizeof(double));
        for (int j = 0; j < NP; j++) row[NX + j] = s->B[i + NX * j];
        for (int k = 0; k < NX; k++) {{
            const double a = s->A[i + NX * k];
            if (a != 0.0)
                for (int j = 0; j < NS; j++) row[j] += a * S[k][j];
        }}
    }}
}}

static void output(const double *x, const double *w, const double *theta, const double S[NX][NS],
                   double *y, double *dy, scratch *s) {{
    double C[NY * NX], D[NY * NP + 1];
    const double *arg[{n_arg}] = {{x, w, theta}};
    double *res[{n_res}] = {{y, C, D}};
    measured(arg, res, s->iw, s->w, 0);
    for (int i = 0; i < NY; i++) {{
        double *row = dy + i * NS;
        memset(row, 0, NX * sizeof(double));
        for (int j = 0; j < NP; j++) row[NX + j] = D[i + NY * j];
        for (int k = 0; k < NX; k++) {{
            const double c = C[i + NY * k];
            if (c != 0.0)
                for (int j = 0; j < NS; j++) row[j] += c * S[k][j];
        }}
    }}
}}

/* Windows of m steps of h seconds, each in equal pieces; inputs: mean and change of each step. */
EXPORT void windows(int count, int m, int pieces, double h, const double *starts,
                    const double *inputs, const double *theta, double *y, double *dy, double *end,
                    double *dend) {{
    casadi_int iw[{size_iw} + 1];
    double work[{size_w} + 1];
    scratch s = {{iw, work}};
    double x[NX], q[NX], k[4][NX], w[NW + 1];
    static _Thread_local double S[NX][NS], Q[NX][NS], dk[4][NX][NS];
    const double d = h / pieces, at[4] = {{0.0, 0.5, 0.5, 1.0}};
    for (int i = 0; i < count; i++) {{
        memcpy(x, starts + i * NX, sizeof x);
        memset(S, 0, sizeof S);
        for (int a = 0; a < NX; a++) S[a][a] = 1.0;
        for (int n = 0; n <= m; n++) {{
            const double *mean = inputs + ((long)i * m + (n < m ? n : m - 1)) * 2 * NW;
            const double *change = mean + NW;
            long place = (long)i * (m + 1) + n;
            output(x, mean, theta, S, y + place * NY, dy + place * NY * NS, &s);
            if (n == m) break;
            for (int p = 0; p < pieces; p++) {{
                for (int r = 0; r < 4; r++) {{
                    const double b = r == 0 ? 0.0 : r == 3 ? d : d / 2;
                    for (int a = 0; a < NX; a++) {{
                        q[a] = r ? x[a] + b * k[r - 1][a] : x[a];
                        for (int c = 0; c < NS; c++)
                            Q[a][c] = r ? S[a][c] + b * dk[r - 1][a][c] : S[a][c];
                    }}
                    for (int a = 0; a < NW; a++)
                        w[a] = mean[a] + ((p + at[r]) / pieces - 0.5) * change[a];
                    rates(q, w, theta, Q, k[r], dk[r], &s);
                }}
                for (int a = 0; a < NX; a++) {{
                    x[a] += d / 6 * (k[0][a] + 2 * k[1][a] + 2 * k[2][a] + k[3][a]);
                    for (int c = 0; c < NS; c++)
                        S[a][c] += d / 6 * (dk[0][a][c] + 2 * dk[1][a][c] + 2 * dk[2][a][c]
                                            + dk[3][a][c]);
                }}
            }}
        }}
        memcpy(end + i * NX, x, sizeof x);
        memcpy(dend + (long)i * NX * NS, S, sizeof S);
    }}
}}
"""
_DOUBLES = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")


@final
class Windows:
    """Windows of equal length: outputs and final states, with derivatives.

    `inputs` (S, m, 2 n_w) are mean and change of each feed over each step of `h` seconds.
    """

    def __init__(self, box: GreyBox, inputs: Array, h: float) -> None:
        self.inputs = np.ascontiguousarray(inputs)
        self.h, self.pieces = h, box.pieces(h)
        self.n_x, self.n_p = box.x.numel(), len(box.fitted)
        self._run = _compiled(box)

    def __call__(self, starts: Array, theta: Array) -> tuple[Array, Array, Array, Array]:
        """Return y (S, m + 1, 12), dy (…, n_x + n_p), end (S, n_x) and dend (…, n_x + n_p).

        Derivatives are by the window's initial state (n_x) and by theta (n_p). `starts` is
        (S, n_x).
        """
        count, m, _ = self.inputs.shape
        n_s = self.n_x + self.n_p
        y, dy = np.empty((count, m + 1, 12)), np.empty((count, m + 1, 12, n_s))
        end, dend = np.empty((count, self.n_x)), np.empty((count, self.n_x, n_s))
        self._run(
            count, m, self.pieces, self.h, np.ascontiguousarray(starts), self.inputs,
            np.ascontiguousarray(theta), y, dy, end, dend,
        )  # fmt: skip
        return y, dy, end, dend


@interruptible()
def _compiled(box: GreyBox) -> Callable[..., None]:
    symbols = [box.x, box.w, box.theta]
    functions = []
    for name, source in (("rhs", box.f), ("measured", box.h)):
        value = source(*symbols)
        by = [ca.densify(ca.jacobian(value, s)) for s in (box.x, box.theta)]
        functions.append(ca.Function(name, symbols, [ca.densify(value), *by]))
    generator = ca.CodeGenerator("identified.c", {"with_header": False})
    for f in functions:
        generator.add(f)
    text = generator.dump() + _DRIVER.format(
        n_x=box.x.numel(), n_w=box.w.numel(), n_p=len(box.fitted),
        n_arg=max(f.sz_arg() for f in functions), n_res=max(f.sz_res() for f in functions),
        size_iw=max(f.sz_iw() for f in functions), size_w=max(f.sz_w() for f in functions),
    )  # fmt: skip
    library = compile_shared(generated_sources({"identified.c": text}), name="identified")
    numbers = [ctypes.c_int] * 3 + [ctypes.c_double] + [_DOUBLES] * 7
    run: Callable[..., None] = load_library(library, {"windows": (None, numbers)}).windows
    return run
