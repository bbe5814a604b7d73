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

/// Passes the cells between `from` and `to` to `take`, in order; `None` when a grid of `rows` rows does not cover them.
pub fn cells(grid: Grid, rows: usize, from: f64, to: f64, mut take: impl FnMut(Cell)) -> Option<()> {
    let place = (from - grid.start) / grid.step;
    let end = (to - grid.start) / grid.step;
    let slack = 1e-6; // rounding of times, in grid steps
    // A grid without a step, or times that are no numbers, cover nothing.
    if rows < NODES || !(place >= -slack && end <= (rows - 1) as f64 + slack) {
        return None;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 <= place <= rows - 1, checked above
    let mut cell = (place.max(0.0) as usize).min(rows - 2);
    let mut a = place;
    loop {
        let next = (cell + 1) as f64;
        let b = if cell + 2 == rows { end } else { end.min(next) };
        if b > a {
            let row = cell.saturating_sub(1).min(rows - NODES);
            take(Cell::between(row, a - row as f64, b - row as f64, grid.step));
            a = b;
        }
        if b >= end {
            return Some(());
        }
        cell += 1;
    }
}

impl Cell {
    /// The part between `a` and `b`, in grid steps behind `row`, from the integrals of the Lagrange polynomials.
    fn between(row: usize, a: f64, b: f64, step: f64) -> Self {
        let (at_a, at_b) = (moments(a), moments(b));
        let first: [f64; NODES] = core::array::from_fn(|i| at_b[i].0 - at_a[i].0);
        let second = core::array::from_fn(|i| step * step * (b * first[i] - (at_b[i].1 - at_a[i].1)));
        #[allow(clippy::cast_possible_truncation)] // grids are far below 2^32 rows
        let row = row as u32;
        Self { row, h: (b - a) * step, first: first.map(|weight| weight * step), second }
    }
}

/// Integrals from 0 to `u` of the Lagrange polynomials on 0, 1, 2, 3, and of `u` times each.
fn moments(u: f64) -> [(f64, f64); NODES] {
    const POLYNOMIALS: [[f64; NODES]; NODES] = [
        [1.0, -11.0 / 6.0, 1.0, -1.0 / 6.0],
        [0.0, 3.0, -2.5, 0.5],
        [0.0, -1.5, 2.0, -0.5],
        [0.0, 1.0 / 3.0, -0.5, 1.0 / 6.0],
    ];
    POLYNOMIALS.map(|[c0, c1, c2, c3]| {
        (
            u * (c0 + u * (c1 / 2.0 + u * (c2 / 3.0 + u * (c3 / 4.0)))),
            u * u * (c0 / 2.0 + u * (c1 / 3.0 + u * (c2 / 4.0 + u * (c3 / 5.0)))),
        )
    })
}
