//! The eight material classes, their probabilities, and the maps that heads make.
use crate::base::math::expf;

/// Number of classes.
pub const CLASSES: usize = 8;

/// A material class (the paper's, by its data set).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Class {
    /// Woven and knitted cloth.
    Fabric,
    /// Soil, grass, gravel.
    Ground,
    /// Leather.
    Leather,
    /// Metal.
    Metal,
    /// Diffuse stone.
    StoneDiff,
    /// Polished stone.
    StoneSpec,
    /// Plastics and paint.
    Polymer,
    /// Wood.
    Wood,
}

impl Class {
    /// All classes, in the order of the network's logits.
    pub const ALL: [Self; CLASSES] = [
        Self::Fabric,
        Self::Ground,
        Self::Leather,
        Self::Metal,
        Self::StoneDiff,
        Self::StoneSpec,
        Self::Polymer,
        Self::Wood,
    ];

    /// The name that files, reports and the command line use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fabric => "fabric",
            Self::Ground => "ground",
            Self::Leather => "leather",
            Self::Metal => "metal",
            Self::StoneDiff => "stone-diff",
            Self::StoneSpec => "stone-spec",
            Self::Polymer => "polymer",
            Self::Wood => "wood",
        }
    }

    /// The class of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }
}

/// Probabilities of the classes, in the order of [`Class::ALL`]: each in [0,1], their sum 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassProbabilities(pub [f32; CLASSES]);

impl ClassProbabilities {
    /// All eight the same.
    pub const UNIFORM: Self = Self([1.0 / CLASSES as f32; CLASSES]);

    /// Certainty.
    #[must_use]
    pub fn certain(class: Class) -> Self {
        let mut probabilities = [0.0; CLASSES];
        probabilities[class as usize] = 1.0;
        Self(probabilities)
    }

    /// Softmax of the network's logits; logits that are not finite give [`ClassProbabilities::UNIFORM`].
    #[must_use]
    pub fn softmax(logits: &[f32; CLASSES]) -> Self {
        if !logits.iter().all(|l| l.is_finite()) {
            return Self::UNIFORM;
        }
        let largest = logits.iter().fold(f32::MIN, |a, &b| a.max(b));
        let powers = logits.map(|l| expf(l - largest));
        let sum: f32 = powers.iter().sum();
        Self(powers.map(|p| p / sum))
    }

    /// The probability of one class.
    #[must_use]
    pub fn of(&self, class: Class) -> f32 {
        self.0[class as usize]
    }

    /// The most probable class; the first of equals.
    #[must_use]
    pub fn best(&self) -> Class {
        let better = |a: Class, b: Class| if self.of(b) > self.of(a) { b } else { a };
        Class::ALL.into_iter().reduce(better).unwrap_or(Class::Fabric)
    }
}

/// The classifier's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classification {
    /// What the network believes.
    pub predicted: ClassProbabilities,
    /// What the heads were mixed with: the same, or certainty of the caller's class.
    pub used: ClassProbabilities,
}

/// What else than the classifier's own answer has a say in how the heads are mixed; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mixing {
    /// The answer of another look at the same photo, which is taken for this one's: the classifier need not run.
    pub known: Option<ClassProbabilities>,
    /// What the heads are mixed with, whatever the classifier says.
    pub only: Option<ClassProbabilities>,
}

impl Mixing {
    /// The caller's class, if any, instead of the classifier's.
    #[must_use]
    pub fn only(class: Option<Class>) -> Self {
        Self { only: class.map(ClassProbabilities::certain), ..Self::default() }
    }

    /// The classification when the classifier alone says `own`.
    #[must_use]
    pub fn classification(&self, own: ClassProbabilities) -> Classification {
        let predicted = self.known.unwrap_or(own);
        Classification { predicted, used: self.only.unwrap_or(predicted) }
    }
}

/// What a head makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Map {
    /// 3 planes, linear RGB.
    Albedo,
    /// 3 planes, unit vectors.
    Normal,
    /// 1 plane.
    Roughness,
}

impl Map {
    /// Planes of the map.
    #[must_use]
    pub const fn channels(self) -> usize {
        match self {
            Self::Albedo | Self::Normal => 3,
            Self::Roughness => 1,
        }
    }

    /// The map's name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::Roughness => "roughness",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_again() {
        for class in Class::ALL {
            assert_eq!(Class::from_name(class.name()), Some(class));
        }
        assert_eq!(Class::from_name("glass"), None);
    }

    #[test]
    fn another_looks_answer_and_the_callers_class_take_the_classifiers_place() {
        let a = ClassProbabilities::softmax(&[1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let b = ClassProbabilities::softmax(&[3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let wood = ClassProbabilities::certain(Class::Wood);
        let known = Mixing { known: Some(b), only: None };
        assert_eq!(known.classification(a), Classification { predicted: b, used: b });
        let both = Mixing { known: Some(b), ..Mixing::only(Some(Class::Wood)) };
        assert_eq!(both.classification(a), Classification { predicted: b, used: wood });
        assert_eq!(Mixing::default().classification(a), Classification { predicted: a, used: a });
    }

    #[test]
    fn softmax_sums_to_one_and_survives_extremes() {
        let p = ClassProbabilities::softmax(&[0.0, 1.0, 2.0, 3.0, -1.0, 0.5, 3.0, 2.5]);
        assert!((p.0.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(p.best(), Class::Metal);
        assert!((p.0[1] / p.0[0] - core::f32::consts::E).abs() < 1e-5);
        let p = ClassProbabilities::softmax(&[1e30, -1e30, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(p, ClassProbabilities::certain(Class::Fabric));
        assert_eq!(ClassProbabilities::softmax(&[f32::NAN; 8]), ClassProbabilities::UNIFORM);
        assert_eq!(ClassProbabilities::softmax(&[f32::INFINITY; 8]), ClassProbabilities::UNIFORM);
    }
}
