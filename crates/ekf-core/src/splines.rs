//! Samples against cardinal B-splines of the ninth degree: the test functions of the weak form.
//!
//! The spline of number `k` spans the cells `k` to `k + 9` of a uniform sequence of knots, so that a sample in a cell
//! enters ten sums (Schoenberg 1946; de Boor 2001, ch. IX).

/// Cells that a spline spans, and splines that are not zero in a cell.
pub const CELLS: usize = 10;

/// Values in the ten cells of a spline, at the same distance `within` from the beginning of each.
///
/// `powers` are the coefficients of the ten polynomials, highest power first.
#[must_use]
pub fn pieces(within: f64, powers: &[[f64; CELLS]]) -> [f64; CELLS] {
    let mut value = [0.0; CELLS];
    for power in powers {
        for (v, c) in value.iter_mut().zip(power) {
            *v = *v * within + c;
        }
    }
    value
}

/// The cell of a place on the knots, and how far from its beginning; none where that is no number or far beyond any.
#[must_use]
pub fn cell(place: f64) -> Option<(i64, f64)> {
    const FAR: f64 = 9.0e15;
    if !(place > -FAR && place < FAR) {
        return None;
    }
    #[allow(clippy::cast_possible_truncation)] // within 2^53
    let mut number = place as i64;
    #[allow(clippy::cast_precision_loss)]
    if (number as f64) > place {
        number -= 1;
    }
    #[allow(clippy::cast_precision_loss)]
    Some((number, place - number as f64))
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // small integers are exact
mod tests {
    use super::{CELLS, cell, pieces};

    #[test]
    fn polynomials_are_evaluated_highest_power_first() {
        let mut powers = [[0.0; CELLS]; 3];
        powers[0][1] = 2.0;
        powers[1][1] = -1.0;
        powers[2][4] = 7.0;
        let value = pieces(3.0, &powers);
        assert_eq!(value[1], 15.0);
        assert_eq!(value[4], 7.0);
        assert_eq!(value[0], 0.0);
    }

    #[test]
    fn places_have_cells() {
        assert_eq!(cell(2.25), Some((2, 0.25)));
        assert_eq!(cell(-0.75), Some((-1, 0.25)));
        assert_eq!(cell(-3.0), Some((-3, 0.0)));
        assert_eq!(cell(f64::NAN), None);
        assert_eq!(cell(f64::INFINITY), None);
        assert_eq!(cell(-1e300), None);
    }
}
