"""Every threshold that decides a verdict: its value, unit and reason, and the test or bench that guards it.

One name has one value, so that the whole policy of diagnosis, selection and experiment design can be read on one page;
`make pages` writes it into docs/method.md. Numerical constants
(ridges, grids, numbers of iterations) stay with the code that they serve.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

# ---- search: which effects enter ----

FAMILYWISE_ALPHA = 0.005
"""False-alarm rate of a record, over all alternatives examined. One adequate record in 200 may be given an effect
that it does not need. [probability; benches/hidden.py]"""
DETECTION_PROBABILITY = 0.95
"""Probability with which an effect of the reported detection limit is found. The customary complement of a 5 % miss
rate. [probability; tests/experiment/test_detectability.py]"""
VERDICT_LEAST_BLOCKS = 20
"""Effective blocks below which a record gives no verdict. Fewer blocks do not determine the scatter of scores.
[blocks; tests/hidden/test_hidden.py]"""
BLOCK_SECONDS = 0.25
"""Length of a block of scores, or two periods of the crossover if those last longer. Scores of neighbouring blocks
must be independent. [s; tests/hidden/test_hidden.py]"""
MODEL_NOISE_BLOCKS = 8.0
"""Weight of the model's own noise against the scatter of a score from block to block. An effect that lives in a few
blocks, such as a step, has little scatter to measure. [blocks; tests/diagnosis/search/test_beam.py]"""
SEARCH_DEPTH = 3
"""Largest number of effects that enter together. Further effects enter in the next round, after a fit. [effects;
tests/hidden/test_hidden.py]"""
BEAM_WIDTH = 5
"""Sets that the beam search keeps at each depth. A strong effect may shadow the right pair at the first depth.
[sets; tests/hidden/test_hidden.py]"""
FINALISTS = 8
"""Effects whose shape parameters are refined and whose scores are checked block by block. Refining costs a pass
through the record each time. [effects; tests/diagnosis/search/test_cost.py]"""
BETWEEN_TRIALS_GAIN_SHARE = 0.5
"""Share of the largest gain above which an effect is also tried between its trial shapes. A sharp effect between two
trials would otherwise lose to a smooth rival. [share; tests/diagnosis/search/test_beam.py]"""
DEFERRED_GAIN_SHARE = 0.1
"""Share of the strongest effect's gain below which an effect waits for the next round. What a strong effect leaves
at a trial shape can pass for a weak one. [share; tests/hidden/test_hidden.py]"""
FORMULA_LACK_OF_FIT_ALPHA = 1e-3
"""Probability of what a smooth curve explains beside a formula below which the formula is rejected. A true one is
rejected in one record of a thousand. [probability; tests/selection/test_formulas.py]"""

# ---- slow noise and homogeneity: whether an effect has one size ----

SLOW_NOISE_SIGMA = 2.0
"""Standard deviations above its fit at which slow noise stands in the null. Below the lowest frequencies that finalists
leave free its spectrum is extrapolated. [sigma; tests/diagnosis/search/test_slow_noise.py]"""
SLOW_NOISE_BEYOND_DOUBT = 20.0
"""Least gain in log-likelihood, the noise's spectrum estimated with and without it, by which an effect is no part of
the slow noise. Of records whose noise is slow alone the most is 11. [1; tests/diagnosis/test_turning.py]"""
RECORD_PARTS = 8
"""Parts of a record, or of all runs together, whose sizes of an effect are compared. More parts hold too little of
an effect to differ. [parts; tests/diagnosis/search/test_homogeneity.py]"""
HOMOGENEITY_ALPHA = 1e-3
"""Probability of the differences between the parts below which an effect does not have one size. A true effect is
refused in one record of a thousand. [probability; tests/diagnosis/search/test_homogeneity.py]"""
ENGINES_APART = 4.0
"""Difference of two independent estimates of one record, over its standard deviation, beyond which the verdict says so
and nothing is called adequate. Their errors of method are small beside the noise that both share.
[standard deviations; tests/diagnosis/test_independent_estimate.py]"""
ENGINES_LEAST_STD = 0.1
"""Least standard deviation of that difference, over that of the estimate. What matters less than the uncertainty is no
difference. [share; tests/diagnosis/test_independent_estimate.py]"""
EQUAL_SIZE_SHARE = 0.1
"""Difference of sizes, over the size, that counts as equal, rms. Shape parameters and the smoothed motion are not
exact, which the standard deviations of a strong effect do not show. [share;
tests/diagnosis/search/test_homogeneity.py]"""
EXCITING_SHARE = 0.05
"""Information of a part, over the mean of all parts, from which it excites an effect. What leaks in from its
neighbours is less. [share; tests/diagnosis/search/test_homogeneity.py]"""

TRANSVERSE_ALPHA = 1e-4
"""False-alarm rate of a coherence of the residual with a side channel, over all bands. It is a remark, not a name.
[probability; tests/diagnosis/test_transverse.py]"""
COHERENCE_LEAST_SHARE = 0.05
"""Share of the residual's power in a band below which a coherence is not worth a remark. A long record shows any
trace. [share; tests/diagnosis/test_transverse.py]"""

# ---- confounding: which effects one record does not separate ----

CLASS_WEIGHT = 0.99
"""Posterior weight, all candidates equally likely before, of the smallest set of effects that is reported as one class.
A class that misses the truth once in a hundred names seldom what is wrong. [probability; benches/hidden.py]"""
NEXT_LEAST_FALL = 0.2
"""Expected fall of the entropy of a class, over the entropy, below which no further run is said to separate it.
Repeating the motion lets it fall a little by noise alone. [share; tests/experiment/test_next_runs.py]"""
INDEPENDENT_PIECES = 1000.0
"""Independent pieces of a record at most: a gain g counts as n log(1 + g/n), as where the variance is unknown.
What an effect leaves by errors of its shape and of the smoothed motion is then noise, which no length of the record
makes smaller. [pieces; benches/hidden.py]"""
RESOLVED_WAVE_PERIODS = 2.0
"""Periods on the travel from which a wave over position is known to repeat. A part of a wave is any smooth function
of position. [periods; tests/hidden/test_hidden.py]"""
RESOLVED_MEMORIES = 3.0
"""Time constants in a record from which the memory of a driver is told from a drift. Within less it is an integral,
which only rises. [time constants; benches/mechanisms.py]"""
COLLINEAR_CORRELATION = 0.9
"""Correlation of two estimates above which both effects describe one curve of their variable. One of them then only
bends the other's function. [correlation; tests/selection/test_collinearity.py]"""
FAMILY_REMAINDER_ALPHA = 0.02
"""False-alarm rate of a nonparametric curve that still explains something next to effects of its variable. It makes
one effect uncertain and replaces several. [probability; tests/selection/test_collinearity.py]"""
NAMED_ALTERNATIVES = 2
"""Named effects that are tried in place of a nonparametric curve. Each costs a fit and a diagnosis. [effects;
tests/hidden/test_hidden.py]"""

SEARCH_MODELS = 10
"""Models that a search for missing effects fits and judges, the base model included; then it says what it has. A count
and not a time, so that every machine ends at the same model; 30 records of worlds and regimes, most of them hard, took
one to four.
[models; tests/selection/test_budget.py]"""

# ---- validation: which effects may stay ----

VALIDATION_BLOCKS = 16
"""Blocks, alike in time and power of the effect, into which the fitted runs are cut together for cross-validation. More
would be shorter than slow
noise, fewer would not determine the scatter of the differences. [blocks; tests/selection/test_cross_validation.py]"""
VALIDATION_LEAST_BLOCKS = 8
"""Blocks below which cross-validation refuses no effect. A standard error from fewer is too uncertain. [blocks;
tests/selection/test_cross_validation.py]"""
VALIDATION_SIGMA = 2.0
"""Rise of the error on left-out blocks, in paired standard errors, above which an effect does not enter. A true effect
lets it fall. [sigma; tests/selection/test_cross_validation.py]"""
VALIDATION_LEAST_FALL = 0.5
"""Fall of one of the errors on left-out blocks, in paired standard errors, without which an effect that is spread over
several blocks does not enter. Of what slow noise alone explains, half has no fall at all. [sigma;
tests/selection/test_cross_validation.py]"""
VALIDATION_SPREAD = 2.0
"""Blocks of equal power over which an effect must be spread for that. One that lives in a single one is not predicted
there from the others. [blocks; tests/selection/test_cross_validation.py]"""
VALIDATION_RISE = 0.05
"""Rise of the rms drift on left-out blocks, as a share, below which it does not matter. An effect of high frequencies
leaves the drift as it is, up to chance. [share; tests/selection/test_cross_validation.py]"""
VALIDATION_HORIZON = 2.0
"""Longest time over which a drift on left-out blocks is taken. Several must fit into a block. [s;
tests/selection/test_cross_validation.py]"""
HELDOUT_RISE = 0.05
"""Rise of the held-out error over that of the best step, as a share, that is remarked on if it exceeds two paired
standard errors. A smaller one changes no decision. [share; tests/selection/test_improvement.py]"""
CONTRADICTED_SIGMA = 3.0
"""Rise of the systematic error of a held-out record with an effect, in paired standard errors, above which that record
contradicts it. A true effect lets it fall. [sigma; tests/selection/test_contradicted.py]"""
CONTRADICTED_D = 5.0
"""Distance between the models with and without an effect, in the systematic error of a held-out record, from which that
record can contradict it. What it hardly shows it cannot deny. [sigma; tests/selection/test_contradicted.py]"""
DETERMINED_ALPHA = 0.01
"""Probability of what an effect explains beside all others of the fitted model, under the null, from which it has no
size. A delay takes up the lag that was found before it. [probability; tests/selection/test_plausibility.py]"""
PLAUSIBLE_ENCODER_SHARE = 0.1
"""Error of the position channel, over the travel, above which it is no finding. A reference that is wrong by more
measures no position. [share; tests/selection/test_plausibility.py]"""

# ---- verdict: noise and outliers ----

DATA_SHEET_NOISE_RATIO = 1.5
"""Fitted over declared noise density, or over that with a low-pass, above which no model is adequate. Data sheets state
typical values; units scatter by less. [ratio; tests/hidden/test_hidden.py]"""
RESONANCE_SPREAD = 0.1
"""Relative standard uncertainty of the frequency of a resonance up to which it is said, and nothing is named. A worse
one is no line to write. [share; tests/diagnosis/test_undeclared_lowpass.py]"""
REJECTION_ROUNDS = 3
"""Rounds of outlier rejection, each followed by a fit. Smaller outliers show once the larger ones are gone. [rounds;
tests/diagnosis/noise_tests/test_noise_tests.py]"""
NOISE_TEST_ALPHA = 1e-4
"""Significance at which one noise test changes what another one says. A line whose power follows speed is vibration.
[probability; tests/diagnosis/noise_tests/test_noise_tests.py]"""
NOISE_EFFECT_ALPHA = 0.01
"""Significance that an effect on noise needs where a user adds it. The user's choice is one alternative, not a search.
[probability; benches/noise_effects.py]"""
NOISE_TEST_LEAST_BLOCKS = 40
"""Blocks below which no noise test looks for a correlation with the motion. Fewer show none that is significant at
1e-4. [blocks; tests/diagnosis/noise_tests/test_noise_tests.py]"""
JITTER_BAND = 0.3
"""Share of the sampling rate above which jitter of the time stamps is judged. Jitter is white, while the power of a
jump of the jerk falls as f^-4. [ratio; tests/diagnosis/noise_tests/test_unresolved.py]"""
JUMP_TAIL_RATIO = 0.3
"""Power of a jump of the motion above 0.3 of the sampling rate, over its power between 0.1 and 0.2, that is taken off
before jitter is judged. A sampled step of the acceleration has 0.25, smoother ones less, jitter 1. [ratio;
tests/diagnosis/noise_tests/test_unresolved.py]"""
CLEAR_TAIL_RATIO = 3.0
"""Power of a block between 0.1 and 0.2 of the sampling rate, over the usual, below which it holds no jump of a
motion. The six degrees of freedom of noise alone exceed it in one block of 150. [ratio;
tests/diagnosis/noise_tests/test_unresolved.py]"""
UNRESOLVED_MOST_SHARE = 0.25
"""Share of a record that jumps of the motion may fill before nothing in it is named. With more of them most jumps
overlap others, and what lies between is too short to judge. [ratio;
tests/diagnosis/noise_tests/test_unresolved.py]"""
EXAMINED_SIGMA = 4.0
"""Local standard deviations above which a sample is examined for a jump of the motion before it counts. Below it a jump
changes no test of outliers. [sigma; tests/diagnosis/noise_tests/test_unresolved.py]"""
OUTLIER_SIGMA = 5.5
"""Local standard deviations above which a sample may be an outlier. Normal noise exceeds it once in 26 million
samples. [sigma; tests/diagnosis/noise_tests/test_noise_tests.py]"""
OUTLIER_MOST_SAMPLES = 3
"""Length of the longest outlier. More samples in a row are an event of the motion. [samples;
tests/diagnosis/noise_tests/test_noise_tests.py]"""
STEADY_SCATTER_RATIO = 1.15
"""Variance of the log scatter within a span, over that of neighbours, below which the scatter counts as steady. A
longer span determines the noise level better. [ratio; tests/diagnosis/noise_tests/test_noise_tests.py]"""
FAST_SCATTER_RATIO = 2.0
"""Variance of the log scatter of neighbouring blocks, over that of white noise, above which no span is steady.
Coloured noise explains less than this. [ratio; tests/diagnosis/noise_tests/test_noise_tests.py]"""
SEPARATE_POWER_ALPHA = 1e-3
"""Significance at which noise that follows speed is separate from noise that follows jerk, or the reverse. It is a
choice of two, not a search. [probability; tests/diagnosis/noise_tests/test_noise_tests.py]"""
VIBRATION_BIN_SIGMA = 3.0
"""Score against speed above which a frequency bin belongs to a vibration. Such bins are kept out of the test for
jitter. [sigma; tests/diagnosis/noise_tests/test_noise_tests.py]"""
VIBRATION_LINE_SHARE = 0.25
"""Distance from a vibration's frequency within which a line belongs to it, over that frequency. A resonance is broad
and its estimate is rough. [share; tests/hidden/test_hidden.py]"""
REPORTED_LINES = 5
"""Most spectral lines that are reported. More are a comb, which is vibration of a machine. [lines;
tests/diagnosis/noise_tests/test_noise_tests.py]"""
MOST_HARMONICS = 4
"""Highest multiple of the frequency of a line, or of a wave over position, that is a column of the same effect. A scale
and the mains have few beyond. [harmonics; tests/workflow/test_waves.py]"""
COMB_HALF_WIDTH = 25.0
"""Distance on either side of a line within which other lines count as its comb. Mains and its sidebands lie closer.
[Hz; tests/diagnosis/noise_tests/test_noise_tests.py]"""
COMB_POWER_RATIO = 3.0
"""Power of the neighbours over that of a line above which the line is a tooth of a comb. A band of noise or a comb
of lines is vibration. [ratio; tests/diagnosis/noise_tests/test_noise_tests.py]"""
CONVERTER_LINE_SHARE = 0.05
"""Amplitude, over a coarse converter step, below which a line may be the converter's own. Steps crossed by a
periodic motion make lines. [share; tests/diagnosis/noise_tests/test_noise_tests.py]"""
REPEATED_LEAST_SHARE = 0.1
"""Share of the readings in motion that repeat the one before, above which the colour of innovations is not tested over
times that the filter averages over. The rounding errors of a coarse encoder follow the position. [share;
tests/diagnosis/noise_tests/test_unresolved.py]"""
PRESENT_SHARE = 0.5
"""Amplitude in the output, over that of a line of the innovations, below which the line is the position's. The motion
that is estimated follows the output, so that innovations hold the lines of both. [share;
tests/diagnosis/noise_tests/test_unresolved.py]"""
SHOWN_SIGMA = 2.0
"""Standard deviations from zero below which an effect that was added is said not to be shown. Chance alone reaches them
in one of twenty. [standard deviations; tests/workflow/test_waves.py]"""
OWN_WAVE_TURNS = 4.0
"""Turns over the record, or over the stroke, within which a line or a wave is the one that the model has. Nearer ones
are one peak of a windowed spectrum. [turns; tests/diagnosis/noise_tests/test_waves.py]"""
MOTION_HARMONICS = 3.0
"""Multiple of the motion's band below which a line may be made by a missing effect. A cubic makes third harmonics.
[ratio; tests/workflow/test_waves.py]"""
MOTION_LINE_RATIO = 3.0
"""Amplitude of a line in the motion, over that in the residual, above which the drive makes the line. The smoothed
motion holds a part of any line. [ratio; tests/diagnosis/noise_tests/test_noise_tests.py]"""
DRIVEN_LINE_RATIO = 20.0
"""Power of a line of the motion's nonlinear functions, over its neighbours, above which the motion makes lines
there. A missing nonlinearity would show as a tone. [ratio; tests/diagnosis/noise_tests/test_noise_tests.py]"""
DRIVEN_LINE_SHARE = 1e-3
"""Share of a function's power below which its line does not count. It would be lost among far stronger ones. [share;
tests/diagnosis/noise_tests/test_noise_tests.py]"""
COARSE_STEP_RATIO = 1.2
"""Converter step over noise above which noise no longer dithers the steps. Rounding then depends on the motion.
[ratio; tests/diagnosis/noise_tests/test_noise_tests.py]"""
HELD_SHARE = 0.2
"""Share of repeated readings in motion above which the logger is faster than the sensor. One that holds repeats every
second to fifth reading; a coarse sensor repeats one now and then. [share;
tests/diagnosis/noise_tests/test_stamps.py]"""
WHOLE_BITS_TOLERANCE = 1e-4
"""Error in bits within which a step is that of a converter of whole bits over the declared range. Such a step is
known from the data sheet. [bit; tests/diagnosis/noise_tests/test_noise_tests.py]"""

# ---- data: change points and faults ----

RELATION_LEAST_BLOCKS = 12
"""Blocks that establish a relation of output and encoder. Four coefficients are fitted to them. [blocks;
tests/diagnosis/test_change_points.py]"""
RELATION_EXPLAINED = 0.95
"""Share of the encoder's power that a relation explains where it holds. Bias, scale and delay alone explain more on
a good record. [share; tests/diagnosis/test_change_points.py]"""
UNRELATED_EXPLAINED = 0.3
"""Share of the begin of a record that its best linear relation explains, below which it is left out. Random readings
have a tenth, a range that was changed within it more than half. [share; tests/field/test_faults.py]"""
BREAK_EXPLAINED = 0.80
"""Share of the encoder's power that no relation may explain after a break. A relation with another scale factor is
no break. [share; tests/diagnosis/test_change_points.py]"""
BREAK_POWER_RATIO = 9.0
"""Residual power after a break over that before it. Effects, vibration and a change from rest to motion stay below.
[ratio; tests/diagnosis/test_change_points.py]"""
BREAK_LOG_LIKELIHOOD = 30.0
"""Log-likelihood that a break must gain. The search over instants and bands is included. [nat;
tests/diagnosis/test_change_points.py]"""
BREAK_BAND_RATIO = 8.0
"""Ratio of the widest to the narrowest band in which the beginning of a break is sought. A slow departure shows in a
narrow band first. [ratio; tests/diagnosis/test_change_points.py]"""
OTHER_SCALE = 1.25
"""Ratio of the scale factors of two parts of a record from which one of them is left out. No effect changes a sensor's
by as much; the steps of range registers and gains do. [ratio; tests/field/test_faults.py]"""
IMPACT_COINCIDENCE = 0.1
"""Time within which an impact must show on both channels. A mount rings for about as long. [s;
tests/diagnosis/test_change_points.py]"""
IMPACT_OUTPUT_RATIO = 50.0
"""Height of an impact over the local spread of the output. Motion of the stage stays far below. [ratio;
tests/diagnosis/test_change_points.py]"""
IMPACT_PEAK_RATIO = 3.0
"""Height of an impact over the next highest peak of the record. Vibration has many peaks of one height. [ratio;
tests/diagnosis/test_change_points.py]"""
IMPACT_ENCODER_RATIO = 20.0
"""Second difference of the encoder at an impact over its usual one. The impact must throw the encoder off too.
[ratio; tests/diagnosis/test_change_points.py]"""
FAULT_ALPHA = 1e-6
"""Family-wise false-alarm rate of a position step. A fault discredits the record, so it must be certain.
[probability; tests/diagnosis/test_change_points.py]"""
DROPOUT_ALPHA = 1e-6
"""Probability, per record, below which so many consecutive samples are not lost one by one. Loggers lose single
samples at random. [probability; tests/diagnosis/test_change_points.py]"""
UNDECLARED_BIAS_INSTABILITY = 0.02
"""Slow change of the bias that is ordinary where no bias instability is declared, rms. Two milli-g, twice the typical
life drift of the poorest sensors of the catalogue. [m/s²; tests/diagnosis/test_turning.py]"""
TURNING_BAND = 2.0
"""Frequency up to which a residual may come from the turning of the sensor. Hands, vehicles and structures turn more
slowly than this. [Hz; tests/diagnosis/test_turning.py]"""
TURNING_LEAST_PERIODS = 12.0
"""Periods of that frequency below which a record shows no slow residual. Fewer do not determine a mean square.
[periods; tests/diagnosis/test_turning.py]"""
TURNING_MOST_DEGREES = 45.0
"""Tilt above which a residual is not explained by turning. Beyond it the input axis is another one. [degrees;
tests/diagnosis/test_turning.py]"""
DRIFT_BAND = 0.1
"""Frequency up to which a residual may be a bias that wanders. A bias drifts with temperature and age, more slowly than
bodies and structures turn. [Hz; tests/diagnosis/test_turning.py]"""
DISTURBED_SHARE = 0.05
"""Share of a record up to which the stretches count as disturbed that hold all of a slow residual. What lasts longer
is the sensor's, or a tilt. [share; tests/diagnosis/test_turning.py]"""
DISTURBED_SECONDS = 4.0
"""Length of such a stretch that counts as disturbed whatever its share. A hand on a cable takes as long in a short
record as in a long one. [s; tests/diagnosis/test_turning.py]"""
DISTURBED_STRETCHES = 3
"""Such stretches at most. More are no accident but happen again and again. [stretches;
tests/diagnosis/test_turning.py]"""
EXPECTED_COHERENCE = 0.8
"""Squared coherence that the noise of both channels leaves, above which a segment must show the relation. Below it
chance and noise decide. [coherence; benches/unrelated.py]"""
RELATED_COHERENCE = 0.5
"""Squared coherence of a band above which output and position are related, however badly. Hysteresis, tilt and
resonance leave more in some band, channels of other axes less. [coherence; benches/unrelated.py]"""
COHERENCE_ALPHA = 1e-3
"""Chance, over all bands, with which one axis is below the least coherence, and with which unrelated channels pass for
related. Both must happen at once. [probability; benches/unrelated.py]"""
RELATION_LEAST_SEGMENTS = 3.0
"""Independent segments with motion below which a missing coherence says nothing. The estimate of unrelated channels
exceeds a third with fewer. [segments; benches/unrelated.py]"""
MISSING_POWER_SHARE = 0.1
"""Share of the output's power that bands without the expected coherence must hold. A barometer errs at frequencies at
which the flight has next to no power. [share; benches/unrelated.py]"""
RELATED_SHARE = 0.9
"""Share of the position's power in a band that a relation of a part of a record must explain to count. Four
coefficients explain less of another axis, however slow the motion. [share; benches/unrelated.py]"""
RELATED_LOG_LIKELIHOOD = 30.0
"""Log-likelihood that a relation of a part of a record must gain to count, in any of a hundred parts and bands. Four
coefficients gain as much by chance once in a million million parts. [nat; benches/unrelated.py]"""
REST_NOISE_RATIO = 10.0
"""Departure of the readings from a steady drift, over their own noise, up to which a record may be at rest. Coloured
noise of a position wanders by several times its white part. [ratio; tests/diagnosis/test_rest.py]"""
REST_LOG_LIKELIHOOD = 20.0
"""Log-likelihood that output and encoder share by chance in a record at rest. Three coefficients in a dozen bands
gain as much once in ten million records. [nat; tests/diagnosis/test_rest.py]"""
RAIL_SAMPLES = 4
"""Equal readings in a row at the extreme of a record, after a jump or beyond the declared range, that are a saturated
output. Three can be quantisation. [samples; tests/diagnosis/test_left_out.py]"""
RAIL_TOLERANCE = 1e-3
"""Distance from the declared range, over that range, within which an output is at its limit. Converters end a few
counts short of it. [share; tests/diagnosis/test_left_out.py]"""
RAIL_NOISE = 4.0
"""The same in standard deviations of an output whose low-passes are inverted. That amplifies its noise. [sigma;
tests/diagnosis/test_left_out.py]"""
RAIL_PILED = 5
"""Readings at the limit over those beyond it, and over those as far below it, least, that are a saturated output. A
sine has at most 2.4 times as many at its peak, and readings beyond mean that the range is another. [ratio;
tests/diagnosis/test_left_out.py]"""
LEFT_OUT_BESIDE = 8
"""Samples of the output on either side of wrong ones that are left out with them. Nothing then interpolates over the
gap, whose motion is always that beyond the limit: a polynomial through its edges errs to one side. [samples;
tests/diagnosis/test_left_out.py]"""
DENIED_RATIO = 3.0
"""Departure of the output from its median over that of which 1 % of its readings are beyond, least, where the
reference is asked. What is smaller is left to the tests of outliers. [ratio; tests/field/test_faults.py]"""
JUNK_RATIO = 10.0
"""Third difference of the output where a record begins or ends, over that of which 1 % are beyond, least, in junk of a
sensor that is switched on. White noise reaches twice. [ratio; tests/field/test_faults.py]"""
DENIED_SIGMA = 4.0
"""Standard deviations that are added to the share that the reference shows before it is judged. A shock in its noise
is then kept. [standard deviations; tests/field/test_faults.py]"""
DENIED_SHARE = 0.15
"""Share of the output's motion in such a stretch that the reference shows, most, where it is no motion. A rig whose
scale factor is a ratio of masses shows a fifth. [share; tests/field/test_faults.py]"""
LOST_SIGMA = 10.0
"""Departure of a reading of velocity from its eight neighbours, over the usual one, that is a drop-out. White noise
reaches six once in a thousand million readings, and its level changes along a record. [sigma;
tests/field/test_channels.py]"""
LOST_STEPS = 4.0
"""Change of speed that a sudden acceleration about a reading makes in so many of its steps, which a drop-out exceeds. A
delay of one sample between the channels leaves one at an impact. [steps; tests/field/test_channels.py]"""
STUCK_SAMPLES = 32
"""Equal readings in a row, while the other channel moves, that are a stuck channel. Fewer are quantisation.
[samples; tests/diagnosis/test_left_out.py]"""
STUCK_MOTION_SHARE = 0.1
"""Spread of the output over that of the whole record, least, where a position that repeats is stuck. A floor that
shakes moves encoder and scale together, by less. [share; tests/diagnosis/test_left_out.py]"""
STUCK_VELOCITY_SHARE = 0.5
"""Change of speed that the output shows over a stuck stretch and the readings beside it do not, most, over its swing. A
sensor that is touched at rest shows one, and the stage rests before and behind. [share;
tests/diagnosis/test_left_out.py]"""
STEP_PULSE_SHARE = 0.6
"""Share of the excess residual around a position step that the filter's pulse must explain. A misfit of the model is
wider than a pulse. [share; tests/diagnosis/test_change_points.py]"""
PLAY_LEAST_REVERSALS = 5
"""Other reversals that show whether every reversal has a step. The median of fewer follows one or two missed counts.
[reversals; tests/diagnosis/test_lost_motion.py]"""
PLAY_RATIO = 2.0
"""Size of a jump at a reversal over the step that nine in ten others stay below, up to which it is the same play. How
much of its play a reversal shows depends on how fast the stage turns. [ratio; tests/diagnosis/test_lost_motion.py]"""
STEP_LEAST_COUNTS = 3.0
"""Least height of a position step, in steps of the encoder. A smaller jump is quantisation. [counts;
tests/diagnosis/test_change_points.py]"""
DELAY_CHANGE_SIGMA = 6.5
"""Standard deviations by which the delay must change where samples were dropped. The search over instants is
included. [sigma; tests/diagnosis/test_change_points.py]"""
WHOLE_SAMPLE_TOLERANCE = 0.15
"""Distance of a change of delay from a whole number of samples, and between bands. Only whole samples can be
dropped. [samples; tests/diagnosis/test_change_points.py]"""

# ---- the page ----


@dataclass(frozen=True, slots=True)
class Threshold:
    """One constant of this module as its docstring describes it."""

    name: str
    value: float
    decides: str
    reason: str
    unit: str
    guard: str
    """Path of the test or bench that fails when the value is wrong."""
    group: str
    """Heading above it."""


def thresholds() -> tuple[Threshold, ...]:
    """Read every constant of this module with its docstring, in their order.

    Raises
    ------
    ValueError
        If a name is defined twice, or a docstring is not "What it decides. The reason. [unit; guard]".
    """
    source = Path(__file__).read_text(encoding="utf-8")
    headings = {n: line.strip("# -") for n, line in enumerate(source.splitlines(), 1) if line.startswith("# ----")}
    table: list[Threshold] = []
    for node, after in pairwise(ast.parse(source).body):
        if not (isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)):
            continue
        name = node.targets[0].id
        if any(threshold.name == name for threshold in table):
            raise ValueError(f"{name} is defined twice")
        value = after.value if isinstance(after, ast.Expr) else None
        text = value.value if isinstance(value, ast.Constant) else ""
        match = re.fullmatch(r"(.*?\.) (.*\.) \[([^;]*); (\S*)\]", " ".join(str(text).split()))
        if match is None:
            raise ValueError(f'{name}: its docstring must be "What it decides. The reason. [unit; guard]"')
        decides, reason, unit, guard = match.groups()
        group = headings[max(n for n in headings if n < node.lineno)]
        table.append(Threshold(name, globals()[name], decides, reason, unit, guard, group))
    return tuple(table)


def markdown() -> str:
    """All thresholds as Markdown tables, one for each group."""
    parts: list[str] = []
    group = ""
    for entry in thresholds():
        if entry.group != group:
            group = entry.group
            title, head = f"**{group[0].upper()}{group[1:]}**", "| threshold | value | decides | because | guard |"
            parts += ["", title, "", head, "|---|---|---|---|---|"]
        parts.append(
            f"| `{entry.name}` | {entry.value:g} {entry.unit} | {entry.decides} | {entry.reason} | `{entry.guard}` |"
        )
    return "\n".join(parts).strip() + "\n"
