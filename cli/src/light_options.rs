//! Lights on the command line.

use relight_core::Direction;
use relight_core::relighter::DirectionalLight;

/// Numbers separated by commas: `first` of them, then perhaps three of a colour.
pub(crate) fn numbers_of(text: &str, first: usize) -> Result<(Vec<f64>, [f32; 3]), String> {
    let numbers = text.split(',').map(|part| part.trim().parse::<f64>().map_err(|_| part.to_owned()));
    let numbers: Vec<f64> =
        numbers.collect::<Result<_, _>>().map_err(|part| format!("'{part}' is not a number"))?;
    let color = match numbers.len() {
        n if n == first => [1.0; 3],
        n if n == first + 3 => [0, 1, 2].map(|c| numbers[first + c] as f32),
        n => return Err(format!("{n} numbers where {first} or, with a colour, {} are needed", first + 3)),
    };
    if color.iter().any(|c| !(0.0..=1e6).contains(c)) {
        return Err("a colour component is outside 0..1e6".to_owned());
    }
    Ok((numbers, color))
}

/// A directional light from `X,Y,Z` or `X,Y,Z,R,G,B`.
pub(crate) fn light_of_vector(text: &str) -> Result<DirectionalLight, String> {
    let (n, color) = numbers_of(text, 3)?;
    let direction = Direction::new(n[0], n[1], n[2]).map_err(|error| error.to_string())?;
    Ok(DirectionalLight { direction, color })
}

/// A directional light from `AZ,EL` in degrees or `AZ,EL,R,G,B`.
pub(crate) fn light_of_angles(text: &str) -> Result<DirectionalLight, String> {
    let (n, color) = numbers_of(text, 2)?;
    let direction = Direction::from_azimuth_elevation(n[0].to_radians(), n[1].to_radians());
    Ok(DirectionalLight { direction: direction.map_err(|error| error.to_string())?, color })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_are_read_with_and_without_color() {
        let light = light_of_vector("-3, 0,4,1,.5,0").unwrap();
        assert_eq!(light.direction.components(), [-0.6, 0.0, 0.8]);
        assert_eq!(light.color, [1.0, 0.5, 0.0]);
        let light = light_of_angles("90,30").unwrap();
        assert!((light.direction.y() - libm_cos_30()).abs() < 1e-15 && light.direction.x().abs() < 1e-15);
        assert_eq!(light.color, [1.0; 3]);
        for text in ["0,0,0", "1,2", "1,2,3,4", "1,2,x", "nan,0,1", "0,0,1,-1,0,0", "0,0,1,inf,0,0"] {
            assert!(light_of_vector(text).is_err(), "{text}");
        }
    }

    fn libm_cos_30() -> f64 {
        0.75f64.sqrt()
    }
}
