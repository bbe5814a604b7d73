//! The sensor's polynomial and its inverse at any parameters.

use arbitrary::{Result, Unstructured};
use ekf_core::{Form, Parameters};

use crate::judge::require_finite;
use crate::numbers::any;

/// Runs the target.
pub fn run(data: &[u8]) {
    let _ = case(&mut Unstructured::new(data)); // bytes that end early are no case
}

fn case(u: &mut Unstructured<'_>) -> Result<()> {
    let form = *u.choose(&[Form::Inverse, Form::Forward])?;
    let input = any(u, 10.0)?;
    let parameters = Parameters { k: any(u, 0.1)?, K0: any(u, 1.0)?, K2: any(u, 1e-2)?, K3: any(u, 1e-3)? };
    let (there, back): (Map, Map) = match form {
        Form::Forward => (Form::acceleration, Form::output),
        Form::Inverse => (Form::output, Form::acceleration),
    };
    // The direction that is solved may refuse; where it does not, the polynomial leads back.
    if let Ok(solved) = there(form, input, &parameters) {
        if parameters.K0.abs() < 1e290 {
            // else the sum of bias and solution may overflow
            require_finite("solved value", &[solved.value]);
        }
        let slope = solved.gradient[0];
        assert!(slope >= 0.0, "an inverse that falls: {slope}");
        let again = back(form, solved.value, &parameters).expect("the polynomial has a value everywhere");
        if again.value.is_finite() && slope.is_finite() {
            let size = input.abs() + parameters.K0.abs() + solved.value.abs() / slope.max(f64::MIN_POSITIVE);
            assert!(
                (again.value - input).abs() <= 1e-6 * size,
                "{input} came back as {} by {parameters:?}",
                again.value
            );
        }
    }
    let _ = back(form, input, &parameters);
    if let Ok((other, _)) = form.swap(&parameters) {
        assert!(!other.k.is_nan(), "k of the other form");
    }
    Ok(())
}

type Map =
    fn(Form, f64, &Parameters) -> core::result::Result<ekf_core::sensor::polynomial::Response, ekf_core::DomainError>;
