//! The uniform grid of the columns: weights that integrate four-point interpolation between two readings.

/// A uniform grid of times, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// First time.
    pub start: f64,
    /// Spacing.
    pub step: f64,
}

/// Grid rows that shape the curve inside one cell.
pub(crate) const NODES: usize = 4;

/// What a part of one grid cell adds to (p, v): `p += h v + second . rows`, `v += first . rows`, the rows being the
/// four from `row` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// First of the four grid rows.
    pub row: u32,
    /// Length of the part, s.
    pub h: f64,
    /// Weights of the rows in the first integral, s.
    pub first: [f64; NODES],
    /// Weights of the rows in the double integral, s^2.
    pub second: [f64; NODES],
}

/// The cells of one grid between readings, in order of time.
///
/// What a place was computed for once is kept: a part begins where the part before it ended, mostly.
#[derive(Debug, Clone, Copy)]
pub struct Cells {
    grid: Grid,
    rows: usize,
    /// Time of the last place, s, and that place in grid steps.
    place: (f64, f64),
    /// Where the last part ended, in grid steps behind its row, and the integrals up to there.
    end: (f64, Moments),
}

impl Cells {
    /// The cells of a grid with `rows` rows.
    #[must_use]
    pub const fn of(grid: Grid, rows: usize) -> Self {
        Self { grid, rows, place: (grid.start, 0.0), end: (0.0, moments(0.0)) }
    }

    /// Passes the cells between `from` and `to` to `take`, in order; `None` when the grid does not cover them.
    #[allow(clippy::float_cmp)] // what was computed for a number serves that number alone
    #[inline(always)]
    pub fn between(&mut self, from: f64, to: f64, mut take: impl FnMut(Cell)) -> Option<()> {
        let Self { grid, rows, .. } = *self;
        let place = if from == self.place.0 { self.place.1 } else { (from - grid.start) / grid.step };
        let end = (to - grid.start) / grid.step;
        let slack = 1e-6; // rounding of times, in grid steps
        // A grid without a step, or times that are no numbers, cover nothing.
        if rows < NODES || !(place >= -slack && end <= (rows - 1) as f64 + slack) {
            return None;
        }
        self.place = (to, end);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 <= place <= rows - 1, checked above
        let mut cell = (place.max(0.0) as usize).min(rows - 2);
        let mut a = place;
        loop {
            let next = (cell + 1) as f64;
            let b = if cell + 2 == rows { end } else { end.min(next) };
            if b > a {
                let row = cell.saturating_sub(1).min(rows - NODES);
                take(self.part(row, a - row as f64, b - row as f64));
                a = b;
            }
            if b >= end {
                return Some(());
            }
            cell += 1;
        }
    }

    /// The part between `a` and `b`, in grid steps behind `row`, from the integrals of the Lagrange polynomials.
    #[inline(always)]
    fn part(&mut self, row: usize, a: f64, b: f64) -> Cell {
        let step = self.grid.step;
        let (at_a, at_b) = (self.moments(a), self.moments(b));
        self.end = (b, at_b);
        let first: [f64; NODES] = core::array::from_fn(|i| at_b.first[i] - at_a.first[i]);
        let second = core::array::from_fn(|i| step * step * (b * first[i] - (at_b.second[i] - at_a.second[i])));
        #[allow(clippy::cast_possible_truncation)] // grids are far below 2^32 rows
        let row = row as u32;
        Cell { row, h: (b - a) * step, first: first.map(|weight| weight * step), second }
    }

    #[allow(clippy::float_cmp)] // as in `between`
    #[inline(always)]
    fn moments(&self, u: f64) -> Moments {
        const ENDS: [Moments; 2] = [moments(1.0), moments(2.0)]; // of a cell inside the grid
        if u == self.end.0 {
            self.end.1
        } else if u == 1.0 {
            ENDS[0]
        } else if u == 2.0 {
            ENDS[1]
        } else {
            moments(u)
        }
    }
}

/// Integrals from 0 on of the Lagrange polynomials on 0, 1, 2, 3, and of the place times each.
#[derive(Debug, Clone, Copy)]
struct Moments {
    first: [f64; NODES],
    second: [f64; NODES],
}

/// Those integrals up to `u`.
#[inline(always)]
const fn moments(u: f64) -> Moments {
    /// Coefficients of the four polynomials, power by power, so that all four are evaluated side by side.
    const POLYNOMIALS: [[f64; NODES]; NODES] = [
        [1.0, 0.0, 0.0, 0.0],
        [-11.0 / 6.0, 3.0, -1.5, 1.0 / 3.0],
        [1.0, -2.5, 2.0, -0.5],
        [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0],
    ];
    let [c0, c1, c2, c3] = POLYNOMIALS;
    let (mut first, mut second) = ([0.0; NODES], [0.0; NODES]);
    let mut i = 0;
    while i < NODES {
        first[i] = u * (c0[i] + u * (c1[i] / 2.0 + u * (c2[i] / 3.0 + u * (c3[i] / 4.0))));
        second[i] = u * u * (c0[i] / 2.0 + u * (c1[i] / 3.0 + u * (c2[i] / 4.0 + u * (c3[i] / 5.0))));
        i += 1;
    }
    Moments { first, second }
}
