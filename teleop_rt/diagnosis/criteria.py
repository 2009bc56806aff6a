"""Levels by which a diagnosis judges: each a prior or a tolerance, with its unit and its reason.

Energies are chi-squares: squares of a residual over the variance of the noise. Shares are of the
energy that the base leaves above the noise (the excess).
"""

SIGMAS = 4.0
"""Standard deviations beyond which nothing is chance: once in 30 000 records."""
LOUD = 2.0
"""Times the noise's deviation: no noise model is off by more, so what is left beyond is unknown."""
ANOTHER_DRAW = 1.3
"""Times the noise's deviation: less is what another draw of the same noise may leave."""
ENCODER_TIMES = 4.0
"""Times the energy of the encoder's errors: an effect is twice as large as they are in force."""
DOUBT_WEIGHT = 3.0
"""Times the relative doubt in the noise's level, by which differences count for less."""

CERTAIN_BIC = 14.0
"""Odds of a thousand to one for one effect (Kass and Raftery 1995: above 10 is very strong)."""
WITHIN_REACH_BIC = 10.0
"""Odds of 150 to one, which exclude a rival (same: very strong)."""
BY_NO_DRAW = 30.0
"""Times the largest of ten draws along one direction: once in a million."""
EXTENDED_GAIN = 6.0
"""Chi-square that one free parameter gains by chance once in 70 times."""
SEARCHED = 3.0
"""Times the encoder's errors along a shape that was searched among them."""

NAMED_SHARE = 0.95
"""Share that a name explains."""
PARTIAL_SHARE = 0.7
"""Share below which an effect is no part worth a name."""
HINT_SHARE = 0.5
"""Share from which the family of an effect is a hint."""
SECOND_SHARE = 0.01
"""Share that a second effect explains at least: another mathematical form of one effect differs
from the declared one by about a tenth of its amplitude, one percent in energy."""
SAME_SHARE = 0.005
"""Share that is no distinction between laws: half of the same."""
SECOND_OF_LEFTOVER = 0.8
"""Share of what the first effect leaves that a second explains: two that are right leave a tenth
at most, two that stand in for another leave a fourth and more."""

DIRECTIONS = 40.0
"""Independent values of what is unknown; 20 to 70 judge synthetic recordings alike."""
EFFECT_COST = 15.0
"""-2 log prior of one more effect of about 27, and Occam's factor of its parameters."""
LEAST_GAIN = 0.04
"""Share of the energy on inner blocks that one more effect explains: 2 % of the error."""
LEAST_SHARE = 0.2
"""Share that an effect of a set explains; less may be the form of another law, off by half."""
MASS = 0.95
"""Of the posterior, that the sets of an answer hold together."""
MOST_SETS = 3
"""Sets in an answer; of more nobody would learn anything."""
CAP = 0.97
"""Highest probability reported [1]: the share of answers above it that campaigns confirm."""
