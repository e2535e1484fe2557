//! The numbers of an enum's cases in a file. A number never changes its meaning.

use crate::nn::input::{Illumination, TruthRange};
use crate::nn::tensor::{Dtype, Edge};

/// Makes `code` and `from_code` of an enum from one list.
macro_rules! codes {
    ($type:ident, $($case:ident = $code:literal),+) => {
        impl $type {
            /// Returns the number of this case in a model file.
            #[must_use]
            pub const fn code(self) -> u32 {
                match self {
                    $(Self::$case => $code,)+
                }
            }

            /// Returns the case of a number in a model file; `None` for an unknown number.
            #[must_use]
            pub const fn from_code(code: u32) -> Option<Self> {
                match code {
                    $($code => Some(Self::$case),)+
                    _ => None,
                }
            }
        }
    };
}

codes!(Dtype, U8 = 0, I16 = 1, F32 = 2);
codes!(Edge, Zero = 0, Nearest = 1);
codes!(TruthRange, Own = 0, Reference = 1, Pixel = 2);
codes!(Illumination, Any = 0, Northwest = 1, Given = 2, Weighed = 3, Sloped = 4);

#[cfg(test)]
mod tests {
    use super::*;

    /// A released number keeps its meaning, because files contain it.
    #[test]
    fn numbers_are_those_of_released_files() {
        assert_eq!([Dtype::U8, Dtype::I16, Dtype::F32].map(Dtype::code), [0, 1, 2]);
        assert_eq!([Edge::Zero, Edge::Nearest].map(Edge::code), [0, 1]);
        assert_eq!([TruthRange::Own, TruthRange::Reference, TruthRange::Pixel].map(TruthRange::code), [0, 1, 2]);
        use Illumination::{Any, Given, Northwest, Sloped, Weighed};
        let light = [Any, Northwest, Given, Weighed, Sloped];
        assert_eq!(light.map(Illumination::code), [0, 1, 2, 3, 4]);
    }

    #[test]
    fn every_number_is_read_as_what_wrote_it_and_no_other_is_read() {
        for code in 0..9 {
            assert_eq!(Dtype::from_code(code).map_or(9, Dtype::code), if code < 3 { code } else { 9 });
            assert_eq!(Edge::from_code(code).map_or(9, Edge::code), if code < 2 { code } else { 9 });
            assert_eq!(TruthRange::from_code(code).map_or(9, TruthRange::code), if code < 3 { code } else { 9 });
            assert_eq!(Illumination::from_code(code).map_or(9, Illumination::code), if code < 5 { code } else { 9 });
        }
    }
}
