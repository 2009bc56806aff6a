"""Decision levels of a diagnosis: each is a prior or a tolerance, with its unit and its reason.

Energies are chi-squares: the squared residual divided by the variance of the noise. Shares refer to
the excess: the energy of the base's residual above the noise.
"""

SIGMAS = 4.0
"""Standard deviations above which a value is significant: chance exceeds it once in 30 000."""
EXCESS_NOISE_RATIO = 2.0
"""Times the noise's deviation: no noise model errs by more, so a larger residual is no noise."""
HIDDEN_SHARE = 0.01
"""Share of the noise's energy, a tenth of its deviation, that lowers the error by half a percent:
every rig hums or rubs as much, and a model without it predicts as well."""
NOISE_POWER_DOUBT = 0.25
"""Share of the noise's power by which its estimate may err."""
REDRAWN_NOISE_RATIO = 1.3
"""Times the noise's deviation: another draw of the same noise may be as large as that."""
ENCODER_ENERGY_RATIO = 4.0
"""Times the energy of the encoder errors: the effect's force is then twice theirs."""
DOUBT_WEIGHT = 3.0
"""Times the relative uncertainty of the noise level: thresholds rise by this product."""

CERTAIN_BIC = 14.0
"""Odds of a thousand to one for one effect (Kass and Raftery 1995: above 10 is very strong)."""
WITHIN_REACH_BIC = 10.0
"""Odds of 150 to one, at which a rival is excluded (the same source: very strong)."""
BEYOND_ENCODER_DRAWS = 30.0
"""Times the largest energy of ten encoder draws along one direction: once in a million."""
SPECIAL_CASE_GAIN = 6.0
"""Chi-square that one free parameter gains by chance once in 70 times."""
SEARCHED_SHAPE_FACTOR = 3.0
"""Factor on the encoder errors along a shape: its search also fits these errors."""

NAMED_SHARE = 0.95
"""Share that a named set must explain."""
PARTIAL_SHARE = 0.7
"""Share that an effect must explain to be reported as a part."""
HINT_SHARE = 0.5
"""Share that an effect must explain for its family to be reported as a hint."""
CONFIRMED_SHARE = 0.5
"""Share of its gain that a set must keep on held-out blocks: correct sets keep 0.97 or more, laws
that imitate noise 0.35 or less."""
SECOND_SHARE = 0.01
"""Share that the form of a law may miss: another mathematical form of an effect differs from the
declared one by about a tenth of its amplitude, which is one percent of its energy."""
SAME_SHARE = 0.005
"""Share within which two laws fit equally well: half of `SECOND_SHARE`."""

UNKNOWN_DIRECTIONS = 40.0
"""Independent values of the unknown remainder; 20 to 70 give equal verdicts on synthetic data."""
EFFECT_COST = 15.0
"""-2 log prior of one more effect of about 30, and Occam's factor of its parameters."""
LEAST_GAIN = 0.04
"""Share of the energy on inner blocks that one more effect must explain: 2 % of the error."""
LEAST_SHARE = 0.2
"""Share that each named effect must explain; a smaller one may correct the form of another law."""
POSTERIOR_MASS = 0.95
"""Posterior probability that the sets of an answer hold together [1]."""
MOST_SETS = 3
"""Sets in an answer; a longer list gives the user no information."""
HIGHEST_PROBABILITY = 0.97
"""Highest probability reported [1]: the share of answers above it that campaigns confirm."""
HIGHEST_BESIDE_UNKNOWN = 0.7
"""The same where an unknown remainder is left: of 52 effects so named in recordings by others 28
were at work, and 22 of 25 measured machines got a right set."""
LEAST_CONFIDENCE = 0.5
"""Highest probability [1] below which a set is partly named: it is wrong more often than right."""
LOWEST_BOUND = 0.4
"""Lowest of these highest probabilities [1], for sets that leave several times the noise."""
