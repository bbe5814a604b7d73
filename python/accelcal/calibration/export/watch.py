"""The watch of an exported filter: for effects that its model lacks, how much its innovations say for each of them.

The watch is that of `ekf-core` (`structured/watch.rs`, `structured/whitening.rs`). What a suspect of its typical size
leaves in the filter is traced with the filter's own steps and gains; so scaled, no number leaves the range of single
precision. Whitening has gains of zero before it begins, and nothing is counted until then.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from itertools import combinations_with_replacement
from typing import Any, TypeAlias

import numpy as np

from accelcal.calibration.export.calibration import identifier, plain, unit as ascii_unit
from accelcal.calibration.export.symbols import (
    FORMATS,
    Graph,
    Symbol,
    at_most,
    exponential,
    largest,
    least,
    less,
    logarithm,
    over,
    root,
    select,
)
from accelcal.data import Array
from accelcal.filters.live_model import FALSE_NAMES

Belief: TypeAlias = Any
"""These five are those of `filter`, which imports this file."""
Program: TypeAlias = Any
Push: TypeAlias = Any
Update: TypeAlias = Any
Text: TypeAlias = Any

STATES = 6
"""Of the whitening: errors of p and v, and the noise of each sample that still drives."""
PAIRS = tuple(combinations_with_replacement(range(STATES), 2))
TAILS = (1.0, 10.0, 100.0)
"""Standard deviations of the prior in typical sizes; these and the next as in `watch.rs`."""
FROM_BEGIN, STARTS, EIGHTH = 0.5, 128, 8
FIELDS = {
    "white": "variance of a sample's noise, zero before the first correction",
    "W": "covariance of the errors of p, v and samples, row by row",
    "N": "what noise of the readings has in it",
    "ahead": "mean of these errors",
    "leaning": "how noise of the output is in the suspects",
    "suspects": "what a typical size of each leaves in p, v, theta and ahead: always, lately",
    "sums": "score and information of each, likewise",
    "lost": "what their rounding left out",
}


def symmetric(entry: Callable[[str], Any], name: str, mark: str) -> list[list[Any]]:
    """A covariance (6, 6) of fields that hold one half of it."""
    half = {pair: entry(f"@{name}[{at}]{mark}") for at, pair in enumerate(PAIRS)}
    return [[half[min(i, j), max(i, j)] for j in range(STATES)] for i in range(STATES)]


def dot(x: Sequence[Any], y: Sequence[Any]) -> Any:
    """A sum of products."""
    return sum((a * b for a, b in zip(x, y, strict=True)), 0.0)


def rows(plan: Program, mark: str) -> list[list[Any]]:
    """Both sensitivities of each suspect: in p and v, the parameters, and the whitening."""
    width = 2 + len(plan.free) + STATES
    return [
        [plan.graph.leaf(f"@suspects[{r * width + i}]{mark}") for i in range(width)]
        for r in range(2 * len(plan.suspects))
    ]


def stored(changed: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """Targets of both sensitivities of each suspect."""
    return {f"@suspects[{i}]": x for i, x in enumerate(x for row in changed for x in row)}


def predicted(plan: Program, step: Push, slope: Any, taps: Array, columns: Any, slopes: Any) -> dict[str, Any]:
    """Fields of the watch over a step, by name.

    Parameters
    ----------
    slope : da/du.
    taps : (4, 2) what each sample adds to position and velocity.
    columns, slopes : (3, n) and (n,) of the effects, suspects last.
    """
    if not plan.suspects:
        return {}
    leaf, h, m = plan.graph.leaf, plan.live.settings["dt"], len(plan.free)
    moves = [[1.0, h, *(slope * taps[:, 0])], [0.0, 1.0, *(slope * taps[:, 1])]]
    targets: dict[str, Any] = {}
    for name, newest in (("W", leaf("@white")), ("N", 0.0)):
        P = symmetric(leaf, name, "")
        top = [[dot(row, column) for column in P] for row in moves]
        moved = [[*(dot(row, moves[k]) for k in (0, 1)), *row[3:], 0.0] for row in top]
        moved += [[0.0, 0.0, *row[3:], 0.0] for row in P[3:]] + [[0.0] * 5 + [newest]]
        targets |= {f"@{name}[{at}]": moved[i][j] for at, (i, j) in enumerate(PAIRS)}

    def shifted(mean: Sequence[Any]) -> list[Any]:
        return [*(dot(row, mean) for row in moves), *mean[3:], 0.0]

    ahead = [leaf(f"@ahead[{i}]") for i in range(STATES)]
    targets |= {f"@ahead[{i}]": x for i, x in enumerate(shifted(ahead))}
    before, changed, first = rows(plan, ""), [], len(plan.live.names) - 2
    for j, scale in enumerate(plan.suspects.values()):
        begin, middle, end = columns[:, first + j]
        sixth, total = slope * (-h / 6.0 * scale), begin + 2.0 * middle
        forcing = sixth * (h * total), sixth * (total + 2.0 * middle + end)
        for p, v, *others in before[2 * j : 2 * j + 2]:
            theta, mean = others[:m], others[m:]
            motion = p + h * v + forcing[0] + dot(step.to_p, theta), v + forcing[1] + dot(step.to_v, theta)
            changed.append([*motion, *(x * y for x, y in zip(theta, step.left, strict=True)), *shifted(mean)])
        if isinstance(slopes[first + j], Symbol) or slopes[first + j] != 0.0:
            targets[f"@leaning[{j}]"] = scale * slopes[first + j]
    return targets | stored(changed)


def read(plan: Program, b: Sequence[Any], e: Any, update: Update, settled: Update) -> dict[str, Any]:
    """Fields of the watch behind a reading with the innovation e and the columns b of the parameters, by name."""
    if not plan.suspects:
        return {}
    leaf, settings, m = plan.graph.leaf, plan.live.settings, len(plan.free)
    tau, R = settings["tau"], settings["r_position"]
    begun = less(0.0, leaf("@white#"))

    def at_reading(x: Sequence[Any]) -> Any:
        return x[0] + tau * x[1]

    W, N = (symmetric(leaf, name, "#") for name in ("W", "N"))
    in_W, in_N = ([at_reading(row) for row in P] for P in (W, N))
    s, noise = at_reading(in_W) + R, at_reading(in_N) + R
    L = [x * over(1.0, s) for x in in_W]
    rest = [x - y * noise for x, y in zip(in_N, L, strict=True)]
    ahead = [leaf(f"@ahead[{i}]#") for i in range(STATES)]
    gains = [select(begun, gain, 0.0) for gain in settled.gains]
    inverse = select(begun, over(1.0, s + (update.s - settled.s)), 0.0)

    def whitened(e: Any, mean: Sequence[Any]) -> tuple[Any, list[Any]]:
        left = e - at_reading(mean)
        moved = [x + gain * left for x, gain in zip(mean, L, strict=True)]
        return left, [*(x - gain * e for x, gain in zip(moved, gains, strict=False)), *moved[2:]]

    left, moved = whitened(e, ahead)
    targets = {f"@ahead[{i}]": x for i, x in enumerate(moved)}
    for at, (i, j) in enumerate(PAIRS):
        targets[f"@W[{at}]"] = W[i][j] - L[i] * in_W[j]
        targets[f"@N[{at}]"] = N[i][j] - (L[i] * rest[j] + in_N[i] * L[j])
    scaled, share, upright = left * inverse, (s - noise) * inverse, over(1.0, leaf("@slope#"))
    mixed = [
        leaf(f"@mixed[{i}]#") * upright if isinstance(plan.next[f"@mixed[{i}]"], Symbol) else 0.0 for i in range(m)
    ]
    changed = []
    for r, (p, v, *others) in enumerate(rows(plan, "#")):
        theta, mean, j = others[:m], others[m:], r // 2
        name, scale = f"b{len(plan.live.names) - 2 + j}", tuple(plan.suspects.values())[j]
        psi = at_reading([p, v]) + dot(b, theta)
        if name in plan.first | plan.next:
            plan.first.setdefault(name, 0.0)
            psi = psi + scale * leaf(name)
        of_noise = dot(mixed, theta) - (leaf(f"@leaning[{j}]#") if f"@leaning[{j}]" in plan.next else 0.0)
        white, mean = whitened(psi, mean)
        changed.append([*(x - gain * psi for x, gain in zip([p, v, *theta], update.gains, strict=True)), *mean])
        shared = share * of_noise
        for at, x in ((2 * r, white * scaled + shared), (2 * r + 1, white * white * inverse + shared * of_noise)):
            before, more = leaf(f"@sums[{at}]#"), x
            if plan.format is FORMATS["f32"]:
                more = x + leaf(f"@lost[{at}]#")
                targets[f"@lost[{at}]"] = more - ((before + more) - before)
            targets[f"@sums[{at}]"] = before + more
    return targets | stored(changed)


def begun(plan: Program, belief: Belief) -> dict[str, Any]:
    """Fields with which whitening begins at the first correction, by name."""
    if not plan.suspects:
        return {}
    settings, leaf = plan.live.settings, plan.graph.leaf
    pv, sample = belief.upv * belief.d[1], settings["q"] / settings["dt"]
    start = {
        (0, 0): belief.upv * pv + belief.d[0],
        (0, 1): pv,
        (1, 1): belief.d[1],
        **{(i, i): sample for i in range(2, STATES)},
    }
    waiting, places = at_most(leaf("@white#"), 0.0), {f"@W[{PAIRS.index(pair)}]": x for pair, x in start.items()}
    return {"@white": sample} | {name: select(waiting, x, leaf(f"{name}#")) for name, x in places.items()}


def log_sum(x: Any, y: Any) -> Any:
    """ln(exp(x) + exp(y))."""
    most = largest(x, y)
    return most + logarithm(1.0 + exponential(least(x, y) - most))


def posterior(graph: Graph) -> dict[str, Any]:
    """Logarithm of the e-value, mean and standard deviation by score b and information G, all in typical sizes."""
    b, G = graph.leaf("b"), graph.leaf("G")
    parts = []
    for tail in TAILS:
        spread = 1.0 + tail**2 * G
        variance = over(tail**2, spread)
        parts.append((0.5 * (b * (b * variance) - logarithm(spread)), b * variance, variance))
    total = reduce(log_sum, (log_e for log_e, *_ in parts))
    weights = [exponential(log_e - total) for log_e, *_ in parts]
    mean = dot(weights, [size for _, size, _ in parts])
    square = dot(weights, [variance + (size - mean) * (size - mean) for _, size, variance in parts])
    return {"y[0]": total - math.log(len(TAILS)), "y[1]": mean, "y[2]": root(square)}


def evidence(graph: Graph) -> dict[str, Any]:
    """The weighted mean over both starts, size and deviation by the likelier one, and whether that is the newest."""
    (since, *always), (newest, *lately) = ([graph.leaf(f"{name}[{i}]") for i in range(3)] for name in ("a", "l"))
    since, newest = since + math.log(FROM_BEGIN), newest + math.log((1.0 - FROM_BEGIN) / STARTS)
    later = less(since, newest)
    sizes = {f"y[{i}]": select(later, y, x) for i, (x, y) in enumerate(zip(always, lately, strict=True), start=1)}
    return {"y[0]": log_sum(since, newest), **sizes, "y[3]": select(later, 1.0, 0.0)}


def described(text: Text) -> list[str]:
    """A paragraph of the top of a file."""
    listed = "; ".join(
        f"{j} {term.name} ({ascii_unit(term.unit) or '1'}), typical size {scale:.6g}"
        for j, (term, scale) in enumerate(zip(text.plan.live._suspects, text.plan.suspects.values(), strict=True))
    )
    return [
        f"Watched, effects that the model lacks: {listed}. While the model holds, any of them is named, at whatever "
        f"time, with a probability of {FALSE_NAMES:g} at most; noise of the output is to be small beside the motion."
    ]


def c_declarations(text: Text) -> str:
    """Functions of the header."""
    name, kind, big = text.writer.name, text.writer.type(), text.writer.name.upper()
    names = (identifier(plain(x)).upper() for x in text.plan.suspects)
    places = ",\n".join(f"    {big}_WATCH_{x} = {j}" for j, x in enumerate(names))
    return f"""
/* Places of the suspects. */
enum {{
{places}
}};

/* What the innovations say for a suspect: natural logarithm of its e-value, coefficient and its standard deviation
 * (SI), and how long ago the likelier start is (s, without gaps). Once in a while, not at each sample. 1 without such a
 * suspect. */
int {name}_watch(const {name}_filter *f, unsigned suspect, {kind} *log_e, {kind} *size, {kind} *std, {kind} *since);
/* Place of the likeliest suspect where chance does not explain it, else -1. */
int {name}_named(const {name}_filter *f);
"""


def c_functions(text: Text) -> str:
    """Definitions in front of the step."""
    writer, name, J = text.writer, text.writer.name, len(text.plan.suspects)
    kind, width, zero = writer.type(), 2 + len(text.plan.free) + STATES, writer.literal(0.0)
    lost = [f" + f->lost[2u * row{more}]" if "lost" in text.sizes else "" for more in ("", " + 1u")]
    inner, both = (["    " + line for line in lines] for lines in text.evidence)
    start = text.plan.live.settings
    return f"""\
/* Sums as logarithm of the e-value, size and deviation in typical sizes. */
static void {name}_posterior(const {name}_filter *f, unsigned row, {kind} *y)
{{
    const {kind} b = f->sums[2u * row]{lost[0]}, G = f->sums[2u * row + 1u]{lost[1]};
{chr(10).join(inner)}
}}

/* A new start of the watch, unless something has probably begun. */
static void {name}_restart({name}_filter *f)
{{
    unsigned j, i;
    {kind} y[3];
    for (j = 0u; j < {J}u; ++j) {{
        {name}_posterior(f, 2u * j + 1u, y);
        if (!(y[0] < {writer.literal(math.log(J))})) {{
            return;
        }}
    }}
    for (j = 1u; j < {2 * J}u; j += 2u) {{
        for (i = 0u; i < {width}u; ++i) {{
            f->suspects[{width}u * j + i] = {zero};
        }}
        for (i = 2u * j; i < 2u * j + 2u; ++i) {{
            f->sums[i] = {zero};
{f"            f->lost[i] = {zero};" if lost[0] else ""}
        }}
    }}
    f->begun = {name}_count(f->earlier, f->n);
    f->starts = f->starts + 1u;
}}

int {name}_watch(const {name}_filter *f, unsigned suspect, {kind} *log_e, {kind} *size, {kind} *std, {kind} *since)
{{
    static const {kind} typical[{J}] = {{ {", ".join(map(writer.literal, text.plan.suspects.values()))} }};
    {kind} a[3], l[3], y[4];
    if (suspect >= {J}u) {{
        return 1;
    }}
    {name}_posterior(f, 2u * suspect, a);
    {name}_posterior(f, 2u * suspect + 1u, l);
    if (f->starts == 0u) {{
        l[0] = {writer.literal(-1e30)};
    }}
{chr(10).join(both)}
    *log_e = y[0];
    *size = y[1] * typical[suspect];
    *std = y[2] * typical[suspect];
    *since = ({kind})({name}_count(f->earlier, f->n) - (y[3] > {zero} ? f->begun : 0u)) * {writer.literal(start["dt"])};
    return 0;
}}

int {name}_named(const {name}_filter *f)
{{
    int likeliest = -1;
    unsigned j;
    {kind} log_e, size, std, since, most = {writer.literal(math.log(J / FALSE_NAMES))};
    for (j = 0u; j < {J}u; ++j) {{
        (void){name}_watch(f, j, &log_e, &size, &std, &since);
        if (log_e > most) {{
            most = log_e;
            likeliest = (int)j;
        }}
    }}
    return likeliest;
}}
"""


def due(text: Text) -> list[str]:
    """The end of a step: the watch begins anew at geometric ages."""
    spacing = max(1, text.plan.live.settings["watch"][1])
    if text.writer.language == "c":
        return [
            "    {",
            f"        const uint32_t age = {text.writer.name}_count(f->earlier, f->n);",
            f"        if (age % {spacing}u == 0u && age - f->begun >= age / {EIGHTH}u && f->starts < {STARTS}u) {{",
            f"            {text.writer.name}_restart(f);",
            "        }",
            "    }",
        ]
    return [
        "    let age = self.earlier.saturating_add(self.n);",
        f"    if age % {spacing} == 0 && age.wrapping_sub(self.begun) >= age / {EIGHTH} && self.starts < {STARTS} {{",
        "        self.restart();",
        "    }",
    ]


def interrupted(text: Text) -> list[str]:
    """Statements behind a gap: the suspects have no part in a motion that begins anew."""
    rows, width, zero = 2 * len(text.plan.suspects), 2 + len(text.plan.free) + STATES, text.writer.literal(0.0)
    if text.writer.language == "rust":
        return [
            f"    for row in self.suspects.chunks_exact_mut({width}) {{",
            "        row[..2].fill(0.0);",
            f"        row[{width - STATES}..].fill(0.0);",
            "    }",
        ]
    places = [*range(2), *range(width - STATES, width)]
    return [
        f"    for (unsigned i = 0u; i < {rows * width}u; i += {width}u) {{",
        *(f"        f->suspects[i + {place}u] = {zero};" for place in places),
        "    }",
    ]


def rust_places(text: Text) -> str:
    """Constants and the type of an answer."""
    kind = text.writer.type()
    places = "\n".join(
        f"/// Place of the suspect {x}.\npub const WATCH_{identifier(plain(x)).upper()}: usize = {j};"
        for j, x in enumerate(text.plan.suspects)
    )
    inner, both = (["    " + line for line in lines] for lines in text.evidence)
    return f"""\
{places}

/// What the innovations say for a suspect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {{
    /// Natural logarithm of the e-value.
    pub log_e: {kind},
    /// Coefficient, SI.
    pub size: {kind},
    /// Its standard deviation, SI.
    pub std: {kind},
    /// How long ago the likelier start is, s, without gaps.
    pub since: {kind},
}}

fn posterior(b: {kind}, G: {kind}) -> [{kind}; 3] {{
    let mut y = [0.0; 3];
{chr(10).join(inner)}
    y
}}

fn evidence(a: [{kind}; 3], l: [{kind}; 3]) -> [{kind}; 4] {{
    let mut y = [0.0; 4];
{chr(10).join(both)}
    y
}}
"""


def rust_methods(text: Text) -> str:
    """Methods of the watch."""
    writer, J, width = text.writer, len(text.plan.suspects), 2 + len(text.plan.free) + STATES
    kind = writer.type()
    lost = [f" + self.lost[2 * row{more}]" if "lost" in text.sizes else "" for more in ("", " + 1")]
    cleared = "\n            self.lost[2 * j..2 * j + 2].fill(0.0);" if lost[0] else ""
    return f"""
    fn posterior(&self, row: usize) -> [{kind}; 3] {{
        posterior(self.sums[2 * row]{lost[0]}, self.sums[2 * row + 1]{lost[1]})
    }}

    /// A new start of the watch, unless something has probably begun.
    fn restart(&mut self) {{
        for j in 0..{J} {{
            if !(self.posterior(2 * j + 1)[0] < {writer.literal(math.log(J))}) {{
                return;
            }}
        }}
        for j in (1..{2 * J}).step_by(2) {{
            self.suspects[{width} * j..{width} * (j + 1)].fill(0.0);
            self.sums[2 * j..2 * j + 2].fill(0.0);{cleared}
        }}
        self.begun = self.earlier.saturating_add(self.n);
        self.starts += 1;
    }}

    /// What the innovations say for a suspect; `None` without such a one. Once in a while, not at each sample.
    #[must_use]
    pub fn watch(&self, suspect: usize) -> Option<Evidence> {{
        const TYPICAL: [{kind}; {J}] = [{", ".join(map(writer.literal, text.plan.suspects.values()))}];
        let typical = *TYPICAL.get(suspect)?;
        let mut lately = self.posterior(2 * suspect + 1);
        if self.starts == 0 {{
            lately[0] = {writer.literal(-1e30)};
        }}
        let [log_e, size, std, later] = evidence(self.posterior(2 * suspect), lately);
        let age = self.earlier.saturating_add(self.n);
        let steps = if later > 0.0 {{ age.wrapping_sub(self.begun) }} else {{ age }};
        let since = steps as {kind} * {writer.literal(text.plan.live.settings["dt"])};
        Some(Evidence {{ log_e, size: size * typical, std: std * typical, since }})
    }}

    /// Place of the likeliest suspect where chance does not explain it.
    #[must_use]
    pub fn named(&self) -> Option<usize> {{
        let mut likeliest = (None, {writer.literal(math.log(J / FALSE_NAMES))});
        for j in 0..{J} {{
            if let Some(evidence) = self.watch(j) {{
                if evidence.log_e > likeliest.1 {{
                    likeliest = (Some(j), evidence.log_e);
                }}
            }}
        }}
        likeliest.0
    }}
"""


def compared(text: Text, watched: Array, most: float, table: Callable[[Text, Array, str], str]) -> tuple[str, str, str]:
    """For the replay: tables of what is expected of log_e and size, and how far off they may be; the statements that
    compare; and how many numbers of a check those are, as the end of a sum.

    Parameters
    ----------
    watched : (checks, suspects, 3) log_e, size and standard deviation of the live filter.
    most : how far a size may be off, standard deviations; log_e by as much, and by a fifth of it as a share of itself.
    table : writes rows of numbers.
    """
    if not watched.size:
        return "", "", ""
    writer, (checks, J, _) = text.writer, watched.shape
    kind = writer.type()
    off = most * np.stack([np.maximum(1.0, 0.2 * np.abs(watched[..., 0])), watched[..., 2]], axis=-1)
    expected, far = (table(text, x.reshape(checks, 2 * J), "0.0") for x in (watched[..., :2], off))
    if writer.language == "rust":
        size = f"[[{kind}; {2 * J}]; {checks}]"
        compare = f"""\
            for j in 0..{J} {{
                let watched = filter.watch(j).map_or([{kind}::NAN; 2], |evidence| [evidence.log_e, evidence.size]);
                for (l, x) in watched.iter().enumerate() {{
                    let far = !((x - SAID[k][2 * j + l]).abs() <= FAR[k][2 * j + l]);
                    failed += i32::from(i + 1 == *after && far);
                }}
            }}
"""
        return f"const SAID: {size} = {expected};\nconst FAR: {size} = {far};\n", compare, f" + {2 * J}"
    size = f"[{checks}][{2 * J}]"
    compare = f"""\
            for (j = 0u; j < {J}u && i + 1u == after[k]; ++j) {{
                {kind} log_e, size, std, since;
                if ({writer.name}_watch(&filter, j, &log_e, &size, &std, &since) != 0
                    || !(fabs((double)(log_e - said[k][2u * j])) <= (double)far[k][2u * j])
                    || !(fabs((double)(size - said[k][2u * j + 1u])) <= (double)far[k][2u * j + 1u])) {{
                    ++failed;
                }}
            }}
"""
    tables = f"static const {kind} said{size} = {expected};\nstatic const {kind} far{size} = {far};\n"
    return tables, compare, f" + {J}u"
