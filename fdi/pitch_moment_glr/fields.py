"""What the likelihood ratio of an elevator oscillation is given, holds and tells, a field each."""

from actuators.block import dtype
from actuators.common import reference
from fdi.control_redundancy import force_model
from fdi.pitch_moment_glr.core import NA, NF
from fdi.pitch_moment_glr.decide import NB, TURNS
from fdi.pitch_moment_glr.moment import LATE, LINE, NV, NX, TAPS

NK, NK_A = 24, 6  # most quantities of lift, drag and pitch, and those with angle of attack

PARAMS = dtype(
    [
        *[(n, k, (force_model.NA, force_model.NM, 2, NK_A)) if n == "t_a"
          else (n, k, (force_model.NM, force_model.NQ, NK)) if n == "t_m"
          else (n, k, (NK,)) if n in ("axis", "variable", "effector") else (n, k, *rest)
          for n, k, *rest in force_model.PARAMS if "thrust" not in n and n not in ("idle", "mil", "n_tm", "n_tp",
                                                                                   "engine")],
        *[(n, "f8", (2,), u) for (n, _), u in zip(
            reference.PARAM_FIELDS, ("1/s", "1/s", "1/s", "rad/s", "rad/s2", "rad/s3"), strict=True)],
        ("part", "f8", (2,), "-"),  # of the elevators that is hydraulic, electromechanical
        ("arm", "f8", "m"),  # of the hydraulic ones: surface angle to rod
        ("late", "f8", "s"),  # age of the pitch acceleration
        ("limit_low", "f8", "rad"),  # travel
        ("limit_high", "f8", "rad"),
        ("stride", "f8", "-"),  # ticks of a sample
        ("turn_c", "f8", (NF,), "-"),  # of each frequency in a sample
        ("turn_s", "f8", (NF,), "-"),
        ("keep", "f8", (NF,), "-"),  # what is left of its sums after a sample
        ("period", "f8", (NF,), "s"),
        ("threshold", "f8", (NB,), "-"),  # of twice the log likelihood ratio
        ("prior", "f8", (NX,), "-"),  # standard deviation of theta before anything is learned
        ("walk", "f8", (NX,), "1/s"),  # growth of its variance
        ("share", "f8", "-"),  # of the flown terms that no coefficient takes out
        ("tau_high", "f8", "s"),  # of the high pass
        ("tau_noise", "f8", "s"),  # memory of the autocorrelations
        ("tau_local", "f8", "s"),  # and of the innovations' variance
        ("t_learn", "f8", "s"),  # from this time on it judges
        ("t_settle", "f8", "s"),  # and from this on it learns
        ("t_release", "f8", "s"),  # an alarm outlives its cause by this
        ("alpha_max", "f8", "rad"),  # beyond it the moment is not linear in anything
        ("blend", "f8", (TAPS,), "-"),  # filter of the gyro's part of the pitch acceleration
        ("tail_arm", "f8", "m"),  # from the centre of gravity aft to the tail
        ("behind", "f8", "s"),  # that air data are older than all other readings
        ("taken", "f8", "-"),  # share of a reading that is taken over in a tick, so that it is as old as they are
        ("fine", "f8", "-"),  # ticks of the gust's line
        ("thrust_arm", "f8", "1/m"),  # pitch acceleration over the acceleration along the body that thrust makes
        ("swing_roll", "f8", "-"),  # roll acceleration over pitch acceleration of the left elevators
    ]
)  # fmt: skip
MEASURED = {
    "alpha": "rad", "alpha_ground": "rad", "q": "rad/s", "qdot": "rad/s2", "p": "rad/s", "r": "rad/s", "n_x": "g",
    "n_z": "g", "theta": "rad", "phi": "rad", "tas": "m/s", "v_ground": "m/s", "cas": "m/s", "mach": "-", "mass": "kg",
    "cg": "-", "pdot": "rad/s2",
}  # fmt: skip
INPUTS = dtype(
    [
        ("command", "f8", "rad"),  # of the elevators, trailing edge down +
        ("stab", "f8", "rad"),
        *[(n + t, "f8", "-" if t else unit) for n, unit in MEASURED.items() for t in ("", "_valid")],
    ]
)
STATE = dtype(
    [
        ("r", "f8", "-"),  # largest likelihood ratio over its threshold
        ("alarm", "f8", "-"),
        ("verdict", "f8", "-"),
        ("culprit", "f8", "-"),  # index into CULPRITS
        ("valid", "f8", "-"),
        ("why", "f8", "-"),
        ("frequency", "f8", "Hz"),  # of the likeliest oscillation
        ("lost", "f8", "-"),  # change of what the command does since then, and its standard deviation
        ("lost_sd", "f8", "-"),
        ("lean", "f8", "-"),  # roll over pitch acceleration of it over that of the left elevators: 1 left, -1 right
        ("lean_sd", "f8", "-"),
        ("m", "f8", (2,), "rad"),  # servo models, hydraulic and electromechanical
        ("md", "f8", (2,), "rad/s"),
        ("mdd", "f8", (2,), "rad/s2"),
        ("command", "f8", "rad"),
        ("stab", "f8", "rad"),
        ("q_1", "f8", "rad/s"),  # pitch rate of the sample before, and before that
        ("q_2", "f8", "rad/s"),
        ("a_1", "f8", "rad/s2"),  # pitch acceleration of the sample before
        ("apart", "f8", (TAPS,), "rad/s2"),  # gyro less accelerometer, a ring
        ("plain", "f8", (TAPS,), "rad/s2"),  # accelerometer
        ("fused", "f8", "-"),  # place in both
        ("delayed", "f8", (LATE, NX + 1)),  # terms but the constant, the computed moment, roll
        ("place_d", "f8", "-"),
        ("held", "f8", (10,)),  # q, qdot, alpha_ground, p, r, pdot, n_x, n_z, g's part, v_ground as old as air data
        ("sum_", "f8", (NV + 1,)),  # over the ticks of a sample
        ("mean_", "f8", (NV,)),  # alpha, alpha_ground, q, y, p, r, n_x, n_z, g's part, V, V_ground, elevator
        ("rate", "f8", "rad/s"),
        ("roll", "f8", "rad/s2"),
        ("sum_r", "f8", (4,)),
        ("cas", "f8", "m/s"),
        ("mach", "f8", "-"),
        ("mass", "f8", "kg"),
        ("cg", "f8", "-"),
        ("ticks", "f8", "-"),
        ("started", "f8", "-"),
        ("filled", "f8", "-"),  # 1 once the high pass has started
        ("age", "f8", "s"),
        ("since_steep", "f8", "s"),  # the angle of attack was beyond alpha_max, or readings lost
        ("gone", "f8", "s"),  # time without a complete reading
        ("variable", "f8", (15,)),
        ("part", "f8", (NK,)),
        ("slope", "f8", (6, 3)),
        ("group", "f8", (5,)),
        ("line", "f8", (LINE,), "rad"),  # gust, a ring
        ("head", "f8", "-"),
        ("since_line", "f8", "-"),  # ticks since it got the last
        ("tail", "f8", "rad"),  # gust at the tail
        ("stick", "f8", "-"),  # friction of the hydraulic servo over that of sliding
        ("rub", "f8", "1/m"),  # its mean over a sample and over all elevators, by the arm
        ("slow", "f8", (2,), "rad/s2"),
        ("push", "f8", "rad/s2"),  # moment of thrust
        ("effect", "f8", "1/s2"),  # pitch acceleration of an elevator angle
        ("term", "f8", (NX,), "rad/s2"),
        ("low", "f8", (NX + 2,)),  # of terms, residual, roll
        ("high", "f8", (NX,), "rad/s2"),
        ("theta", "f8", (NX,)),
        ("P", "f8", (NX, NX)),
        ("K", "f8", (NX,)),
        ("xw", "f8", (NX,)),
        ("past", "f8", (NA, NX)),
        ("past_y", "f8", (NA,)),
        ("past_e", "f8", (NA,)),
        ("past_r", "f8", (NA,)),
        ("place", "f8", "-"),
        ("auto", "f8", (NA + 1,), "rad2/s4"),
        ("ar", "f8", (NA,), "-"),
        ("ar_1", "f8", (NA,), "-"),
        ("n_auto", "f8", "-"),
        ("noise", "f8", "rad2/s4"),  # variance of what is whitened
        ("power", "f8", "rad2/s4"),
        ("local", "f8", "rad2/s4"),
        ("local_r", "f8", "rad2/s4"),  # of the whitened roll acceleration
        ("e", "f8", "rad/s2"),  # innovation
        ("s", "f8", "rad2/s4"),
        ("cosine", "f8", (NF,), "-"),
        ("sine", "f8", (NF,), "-"),
        ("since", "f8", "s"),  # the sums began
        *[(n, "f8", (NF,)) for n in ("z_c", "z_s", "z_g", "M_cc", "M_cs", "M_ss", "M_gg", "R_c", "R_s")],
        ("L_c", "f8", (2, NF)),
        ("L_s", "f8", (2, NF)),
        ("d_c", "f8", (4, NF)),
        ("d_s", "f8", (4, NF)),
        ("turn", "f8", "-"),
        ("best", "f8", (TURNS,)),  # largest ratio over threshold of each part of the hypotheses
        ("which", "f8", (TURNS,), "-"),
        ("raw", "f8", (NB,), "-"),  # largest ratio of each band in the part that was looked at last
        ("hold", "f8", "s"),  # time for which the alarm still stands
    ]
)
