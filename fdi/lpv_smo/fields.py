"""What the LPV sliding-mode observer is given, holds and tells, a field each: parameters, inputs, state."""

from actuators.block import dtype
from fdi.common import bank as frequencies
from fdi.common import gyro
from fdi.lpv_smo.core import DELAY, NB, M, N, P, R, T

PARAMS = dtype(
    [
        ("n_box", "f8", "-"),  # boxes in use; each has its own model and design
        ("A", "f8", (NB, R + 1, N, N)),  # A(rho) of (8), canonical coordinates, affine stack
        ("B", "f8", (NB, R + 1, N, M)),  # B(rho) of (8)
        ("E", "f8", (NB, R + 1), "deg/s2 per deg"),  # E_p(rho) = B51 of (35)
        ("D51", "f8", (NB, R + 1), "g/deg"),  # elevator feedthrough into n_z
        ("eq", "f8", (NB, N + M, T)),  # trim maps of canonical state and inputs, cubic in normalised rho
        ("powers", "f8", (T, R)),  # exponents of their monomials
        ("low", "f8", (NB, R)),  # boxes of rho: t, %, kt, -
        ("high", "f8", (NB, R)),
        ("mix", "f8", (NB, P, P)),  # s = mix @ [Z theta V q z_f1 z_f2], the identity for the paper's outputs
        ("L", "f8", (NB, P)),  # (21)
        ("W", "f8", (NB, 3, P)),  # (22)
        ("a22", "f8", (NB, P), "rad/s"),  # diagonal of A22s, negative
        ("a_f", "f8", (NB, 2), "rad/s"),  # diagonal of A_f
        ("gust", "f8", "-"),  # 1: gusts are reconstructed from the angle of attack over the ground and taken out
        ("K", "f8", "-"),  # modulation gain of (15)
        ("delta", "f8"),  # smoothing of (15)
        ("tau_f", "f8", "s"),  # lag of the reconstruction
        ("tau_g", "f8", "s"),  # a second lag of what is free of gusts: the first leaves differentiated white noise
        ("tau_v", "f8", "s"),  # smoothing of V, 0 for none
        ("tau_rho", "f8", "s"),  # smoothing of rho, 0 for none
        ("omega_a", "f8", "rad/s"),  # healthy elevator as a lag of its command, 0 for none
        ("rate_a", "f8", "deg/s"),  # at most so fast is the command followed, 0 for no limit
        ("delay", "f8", "-"),  # of the commands, as long as that of q
        ("sigma_q", "f8", "rad/s"),  # noise of q per sample, for f_sigma of the paper's observer
        ("noise", "f8", (NB, 4)),  # sd of the estimates from sensor noise, as `fdi.lpv_smo.noise` scales them
        ("floor", "f8", "-"),  # sd of f_hat_elevator below which no half period counts
        ("bank", "f8", "-"),  # 1: bank and lateral rates are taken into account
        ("adot", "f8", "-"),  # share of the damping in pitch that is due to the rate of the angle of attack
        ("gradient", "f8", "-"),  # share of the damping in pitch that answers to a gust's rate along the body
        ("thrust", "f8", "deg/s2 per m/s2"),  # what thrust does to pitch, over what it does to speed
        ("inertia", "f8", (2,)),  # (Izz - Ixx) / Iyy, Ixz / Iyy
        ("to_x", "f8", (NB, N, 5)),  # state of the paper to canonical state
        ("t_elevator", "f8", "rad"),  # thresholds in still air at trim
        ("t_n_z", "f8", "g"),
        ("t_alpha", "f8", "rad"),
        ("least", "f8", (3,), "-"),  # no less, in standard deviations that sensor noise gives each estimate
        # growth with the distance of trim, and of the angle of attack from trim, from where offsets were learned: what
        # the coefficients and the affine model have wrong
        ("s_elevator", "f8", "-"),
        ("s_n_z", "f8", "g/rad"),
        ("s_alpha", "f8", "-"),
        ("g_elevator", "f8", "-"),  # and with the rms of gusts
        ("g_n_z", "f8", "g/rad"),
        ("g_alpha", "f8", "-"),
        ("away_max", "f8", "rad"),  # beyond this |alpha - alpha_eq| the affine model is not believed
        ("alpha_max", "f8", "rad"),  # nor beyond this angle of attack, flown or of trim, where lift is no longer linear
        ("mach_max", "f8", "-"),  # nor beyond this Mach number, where coefficients turn faster than a box follows
        ("lift_min", "f8", "1/s"),  # nor where the path turns by less than this per angle: beside where it trims
        ("t_recover", "f8", "s"),  # nor for so long after it was
        ("gust_0", "f8", "rad"),  # rms of gusts assumed at the start
        ("tau_gust", "f8", "s"),  # memory of that rms
        ("tau_blow", "f8", "s"),  # and how soon it follows a gust that is larger
        ("gust_max", "f8", "rad"),  # it is counted up to here; near it nothing is said: the model is wrong, not the air
        ("t_confirm", "f8", "s"),
        ("t_release", "f8", "s"),
        ("bank_max", "f8", "rad"),  # bank beyond which nothing is said, 0 for no such bound
        ("t_learn", "f8", "s"),  # offsets are learned up to this time, 0 for none
        *frequencies.PARAMS,
        ("swing_threshold", "f8", (frequencies.K,), "rad"),  # amplitude of an oscillation of the elevator's estimate
        ("swing_gust", "f8", (frequencies.K,), "-"),  # its growth with the rms of gusts
        ("swing_away", "f8", (frequencies.K,), "-"),  # and with the distance of the angle of attack
        ("coherence", "f8", "-"),  # least agreement of its two periods
        ("purity", "f8", "-"),  # least share of the window's power that it explains
        ("hits", "f8", "-"),  # fits in a row that must pass
        ("t_settle", "f8", "s"),  # no decision for so long after a (re)start
    ]
)
INPUTS = dtype(
    [
        ("de_lo", "f8", "rad"),  # elevator commands, trailing edge down +
        ("de_li", "f8", "rad"),
        ("de_ri", "f8", "rad"),
        ("de_ro", "f8", "rad"),
        ("stab", "f8", "rad"),  # stabiliser position, trailing edge down +
        ("h", "f8", "m"),  # inertial altitude
        ("h_valid", "f8", "-"),
        ("theta", "f8", "rad"),
        ("theta_valid", "f8", "-"),
        ("V", "f8", "m/s"),  # speed over the ground
        ("V_valid", "f8", "-"),
        ("q", "f8", "rad/s"),
        ("q_valid", "f8", "-"),
        ("n_z", "f8", "g"),  # +1 in level flight
        ("n_z_valid", "f8", "-"),
        ("alpha", "f8", "rad"),
        ("alpha_valid", "f8", "-"),
        ("alpha_ground", "f8", "rad"),  # angle of attack over the ground, read where `gust` is 1
        ("alpha_ground_valid", "f8", "-"),
        ("tas", "f8", "m/s"),  # true airspeed, likewise; without it the air's own speed counts as steady
        ("tas_valid", "f8", "-"),
        ("beta", "f8", "rad"),  # sideslip of the vane, likewise; without it the aircraft counts as not slipping
        ("beta_valid", "f8", "-"),
        ("phi", "f8", "rad"),
        ("phi_valid", "f8", "-"),
        ("p", "f8", "rad/s"),
        ("p_valid", "f8", "-"),
        ("r", "f8", "rad/s"),
        ("r_valid", "f8", "-"),
        ("mass", "f8", "kg"),
        ("mass_valid", "f8", "-"),
        ("cg", "f8", "-"),  # fraction of the mean chord
        ("cg_valid", "f8", "-"),
        ("cas", "f8", "m/s"),
        ("cas_valid", "f8", "-"),
        ("mach", "f8", "-"),
        ("mach_valid", "f8", "-"),
    ]
)
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest of the three estimates over its threshold
        ("alarm", "f8", "-"),  # 1 while a fault is declared
        ("verdict", "f8", "-"),  # of the culprit: SENSOR; OFC_LIQUID or AMBIGUOUS for the elevator (side unknown)
        ("culprit", "f8", "-"),  # index into CULPRITS: of what is declared, what has been so longest
        ("alarm_elevator", "f8", "-"),  # 1 while this part is declared, whatever else is
        ("alarm_n_z", "f8", "-"),
        ("alarm_alpha", "f8", "-"),
        ("valid", "f8", "-"),  # 1 while settled, inside a box and all inputs usable
        ("why", "f8", "-"),  # code of fdi.common.why, 0 while valid
        ("box", "f8", "-"),  # which of the boxes
        ("f_hat_elevator", "f8", "rad"),  # mean of the four segments, trailing edge down +
        ("f_hat_n_z", "f8", "g"),  # with the feedthrough correction
        ("f_hat_n_z_raw", "f8", "g"),  # as printed
        ("f_hat_alpha", "f8", "rad"),
        ("f_sigma", "f8", "rad"),  # one sigma of f_hat_elevator from sensor noise; the paper's observer: from q alone
        ("sigma", "f8", (2,)),  # one sigma of f_hat_n_z [g] and f_hat_alpha [rad], likewise
        ("alpha_hat", "f8", "rad"),  # estimate of the unmeasured state
        ("gust_hat", "f8", "rad"),  # angle of the gust that was taken out
        ("e_norm", "f8", "deg, m, m/s, deg/s"),  # |e_y|, paper's units
        ("nu_norm", "f8", "-"),  # |nu| / K
        ("e", "f8", (P,)),  # e_y
        ("nu", "f8", (P,)),
        ("s", "f8", (P,)),  # outputs at the last tick
        ("phi", "f8", (P,)),
        ("y2", "f8", (2,)),  # n_z [g], alpha [deg] at the last tick
        ("z", "f8", (2,)),  # z_f
        ("w", "f8"),  # x_hat_1 + L x_hat_2
        ("f", "f8", (3,)),  # lagged W nu / E: deg, g, deg
        ("free", "f8", (3,)),  # the same without gusts, through the lag tau_g
        ("d", "f8", (N,)),  # what bank adds to x'
        ("ground", "f8", "deg"),  # model of alpha_ground, its rate without the gust, what of it is missing
        ("rate", "f8", "deg/s"),
        ("xi", "f8", "deg/s"),
        ("push", "f8", "m/s2"),  # acceleration along the path that the model does not know of, through the lag
        ("wind", "f8", "m/s"),  # airspeed less that over the drifting air, through the lag
        ("slip", "f8", "deg"),  # alpha_hat less alpha_ground, through the lag
        ("ahead", "f8", "m/s"),  # steady wind against the heading, from left to right of it, their variances
        ("across", "f8", "m/s"),
        ("pull", "f8", "m/s2"),  # of speed, that the estimate of x.ahead makes and no force
        ("ahead_var", "f8", "m2/s2"),
        ("across_var", "f8", "m2/s2"),
        ("speed", "f8", "m/s"),  # over the air that drifts with that wind, and the angle of attack over it
        ("over", "f8", "rad"),
        ("lean", "f8", "m/s"),  # what the air's lateral velocity makes of slip, and a unit of that wind, lagged
        ("tilt", "f8", "-"),
        ("blown", "f8", "m/s"),  # what gusts from the side have added to the wind across
        ("lateral", "f8", "m/s"),  # the air's lateral velocity at the last tick, and 1 if the vane told it
        ("vane", "f8", "-"),
        ("side", "f8", "rad"),  # sideslip over the ground
        ("spin", "f8", "rad/s"),  # rate about the path, through the lag
        ("doubt", "f8", "rad"),  # what the wind's deviation may be worth as an angle of a gust
        ("learned", "f8", "-"),  # 1 when the offset holds
        ("n_learn", "f8", "-"),
        ("v_0", "f8", "m/s"),  # speed where learning began
        ("sums", "f8", (3,)),  # running means of the offset: deg, g, deg
        ("offset", "f8", (3,)),
        ("path", "f8", "rad"),  # alpha_hat through a lag of tau_f
        ("alpha_0", "f8", "rad"),  # its mean while offsets were learned, which hold there
        ("trim", "f8", "rad"),  # alpha_eq through a lag, and its mean while offsets were learned
        ("trim_0", "f8", "rad"),
        ("away", "f8", "rad"),  # path less alpha_eq
        ("apart", "f8", "rad"),  # how far the flight is from where offsets were learned, or from trim
        ("calm", "f8", "s"),  # time since it was beyond away_max
        ("gust", "f8", "rad2"),  # mean square of gusts
        ("rms", "f8", "rad"),  # its root, with the doubt about the wind: what limits grow with
        ("rho", "f8", (R,)),  # t, %, kt, -
        ("line", "f8", (DELAY, M), "deg"),  # commands of the last ticks
        ("head", "f8", "-"),
        ("u_0", "f8", "deg"),  # healthy elevator at the start and the end of the tick that ends now
        ("u_e", "f8", "deg"),
        ("u_r", "f8", "deg"),  # the command as far as the rate limit lets it be followed
        ("u_s", "f8", "deg"),  # stabiliser
        ("v_s", "f8", "m/s"),  # smoothed V
        ("age", "f8", "s"),  # time since the (re)start; 0: not started
        ("timer", "f8", (3,), "s"),  # confirmation: elevator, n_z, alpha
        ("held", "f8", (3,), "s"),  # for how long each has been declared
        ("sign", "f8"),  # of the last threshold crossing of f_hat_elevator
        ("half", "f8"),  # alternating crossings, each within a second of the one before
        ("since", "f8", "s"),  # time since the last of them
        *gyro.STATE,
        *frequencies.STATE,
        ("hit", "f8", (frequencies.K,), "-"),  # fits in a row that passed
        ("swing", "f8", "s"),  # time for which an oscillation is still held to be there
        ("A", "f8", (N, N)),  # scratch: A(rho), B(rho), trim maps, powers of rho, right side of the implicit step
        ("B", "f8", (N, M)),
        ("eq", "f8", (N + M,)),
        ("power", "f8", (R, 4)),
        ("b", "f8", (P,)),
    ]
)
