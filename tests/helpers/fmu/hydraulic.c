/* The hydraulic actuator of actuators/hydraulic/actuator.py, healthy and without backlash, as a co-simulation FMU 2 and 3. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { U, HM0, HMD, DELTA_0, P_S, BREAKS, BREAKS_AS, DELTA, ROD, X3, COUNT };
typedef void (*logger2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*logger3)(void *, int, const char *, const char *);
typedef struct { logger2 log; } callbacks2;
typedef struct {
    double y[COUNT], q, v, z;
    int status, tick;
    logger2 log2;
    logger3 log3;
    void *environment;
} Model;

static const double A_p = 0.0025, B = 52.3, M = 2000.0, phi_n = 0.0025, V_m = 0.001973, E = 1e9, L = 0.023, arm = 0.30,
    F_c = 350.0, F_s = 450.0, v_s = 0.01, u_max = 0.30 * 45.0 * 3.141592653589793 / 180.0;

static double clip(double v, double lo, double hi) { return fmin(fmax(v, lo), hi); }
static double sign(double v) { return (v > 0) - (v < 0); }

static void rhs(Model *m, const double *s, double u, double F, double *d) {
    double V2 = V_m * V_m, vol = fmax(V2 - A_p * A_p * s[0] * s[0], 0.1 * V2);
    double k = 2.0 * A_p * E * V_m / (m->y[P_S] * vol);
    double flow = phi_n / A_p * sqrt(fmax(1.0 - sign(u) * s[2], 0.0)) * u;
    d[0] = s[1];
    d[1] = (A_p * m->y[P_S] * s[2] - B * s[1] + F) / M;
    d[2] = k * (flow - L * s[2] - s[1]);
}

static double external(Model *m, double q, double v, double d) {
    double r = v / v_s;
    return (m->y[HM0] + m->y[HMD] * q / arm) / arm - d * (F_c + (F_s - F_c) / (1.0 + r * r));
}

static void slide(Model *m, double *s, double d, double u, double h, int held) {
    double k[4][3], x[3], f[4] = {0, 0.5, 0.5, 1.0};
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j < 3; j++) x[j] = s[j] + (i ? f[i] * h * k[i - 1][j] : 0.0);
        if (held) x[0] = s[0], x[1] = 0.0;
        rhs(m, x, u, external(m, x[0], x[1], d), k[i]);
        if (held) k[i][0] = k[i][1] = 0.0;
    }
    for (int j = 0; j < 3; j++) s[j] += h / 6.0 * (k[0][j] + 2.0 * (k[1][j] + k[2][j]) + k[3][j]);
}

static void substep(Model *m, double h) {
    double u = clip(m->y[U], -u_max, u_max), left = h, s[3], old;
    for (int i = 0; i < 2 && left > 0.0; i++) {
        double net = A_p * m->y[P_S] * m->z + external(m, m->q, 0.0, 0.0), d = m->v != 0.0 ? sign(m->v) : sign(net);
        s[0] = m->q, s[1] = m->v, s[2] = m->z, old = m->v;
        if (m->v == 0.0 && fabs(net) <= F_s) {
            slide(m, s, 0.0, u, left, 1);
            m->z = s[2];
            return;
        }
        slide(m, s, d, u, left, 0);
        if (s[1] * d >= 0.0) {
            left = 0.0;
        } else if (old != 0.0) {
            double part = left * old / (old - s[1]);
            s[0] = m->q, s[1] = m->v, s[2] = m->z;
            slide(m, s, d, u, part, 0);
            s[1] = 0.0;
            left -= part;
        } else {
            s[1] = 0.0, left = 0.0;
        }
        m->q = s[0], m->v = s[1], m->z = s[2];
    }
}

static void out(Model *m) { m->y[ROD] = m->q, m->y[X3] = m->z, m->y[DELTA] = m->q / arm; }

static void begin(Model *m) {
    m->q = arm * m->y[DELTA_0], m->v = 0.0;
    m->z = -(m->y[HM0] + m->y[HMD] * m->y[DELTA_0]) / arm / (A_p * m->y[P_S]);
    out(m);
}

static Model *make(void) {
    Model *m = calloc(1, sizeof *m);
    m->y[P_S] = 1.4e7, m->y[BREAKS] = 1e9, m->y[BREAKS_AS] = 3;
    return m;
}

/* A status of 5 or more is one of FMI 3's ways to end without an error. */
static int advance(Model *m, double t, double dt) {
    int late = t != m->tick * dt;
    if (late || t > m->y[BREAKS]) {
        m->status = late ? 3 : m->y[BREAKS_AS];
        if (m->status > 4) return 0;
        if (m->log2) m->log2(m->environment, "rig", m->status, "error", "seal lost at %s", "the piston");
        if (m->log3) m->log3(m->environment, m->status, "error", "seal lost at the piston");
        return m->status;
    }
    for (int i = 0; i < 5; i++) substep(m, dt / 5.0);
    m->tick += 1;
    out(m);
    return 0;
}

/* After a fatal error nobody may call anything: whoever does ends. */
static int end(Model *m) { return m->status == 4 ? (abort(), 4) : 0; }

/* FMI 2 */
void *fmi2Instantiate(const char *n, int type, const char *guid, const char *r, const callbacks2 *c, int v, int l) {
    Model *m = make();
    m->log2 = c ? c->log : 0;
    return m;
}
int fmi2SetupExperiment(void *m, int a, double b, double t, int c, double d) { return 0; }
int fmi2EnterInitializationMode(void *m) { return 0; }
int fmi2ExitInitializationMode(void *m) { begin(m); return 0; }
int fmi2Terminate(void *m) { return end(m); }
int fmi2Reset(void *m) { return 0; }
void fmi2FreeInstance(void *m) { end(m), free(m); }
int fmi2SetReal(void *c, const unsigned r[], size_t n, const double y[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->y[r[i]] = y[i];
    return 0;
}
int fmi2GetReal(void *c, const unsigned r[], size_t n, double y[]) {
    for (size_t i = 0; i < n; i++) y[i] = ((Model *)c)->y[r[i]];
    return 0;
}
int fmi2DoStep(void *c, double t, double dt, int keep) { return advance(c, t, dt); }
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }

/* FMI 3 */
void *fmi3InstantiateCoSimulation(const char *n, const char *token, const char *r, char v, char l, char e, char early,
                                  const unsigned *req, size_t nr, void *env, logger3 log, void *cb) {
    Model *m = make();
    m->log3 = log, m->environment = env;
    return m;
}
int fmi3EnterInitializationMode(void *m, char a, double b, double t, char c, double d) { return 0; }
int fmi3ExitInitializationMode(void *m) { begin(m); return 0; }
int fmi3Terminate(void *m) { return end(m); }
int fmi3Reset(void *m) { return 0; }
void fmi3FreeInstance(void *m) { end(m), free(m); }
int fmi3SetFloat64(void *c, const unsigned r[], size_t n, const double y[], size_t k) { return fmi2SetReal(c, r, n, y); }
int fmi3GetFloat64(void *c, const unsigned r[], size_t n, double y[], size_t k) { return fmi2GetReal(c, r, n, y); }
int fmi3DoStep(void *c, double t, double dt, char keep, char *event, char *end, char *early, double *last) {
    int status = advance(c, t, dt), how = ((Model *)c)->status;
    *event = 0, *end = how == 5, *early = how == 6;
    *last = how == 6 || how == 7 ? t + 0.4 * dt : t + dt;
    return status;
}
const char *fmi3GetVersion(void) { return "3.0"; }
