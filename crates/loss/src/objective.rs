use burn::tensor::{Device, Tensor};
use infonerf_ops::means::weighted_sum;
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Moment, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, Renders, union};
use crate::term::{Term, TermSpec, Weighted};
use crate::terms::entropy::EntropyConfig;
use crate::terms::kl::KlConfig;
use crate::terms::opacity_prior::OpacityPriorConfig;
use crate::terms::penalties::{LatentConfig, TvConfig};
use crate::terms::photometric::PhotometricConfig;
use crate::terms::semantic::SemanticConfig;
use crate::terms::silhouette::SilhouetteConfig;
use crate::terms::stereo::StereoConfig;

/// Defines [`LossConfig`] from a list of terms: the name of each, which is its table in config files, and its config.
macro_rules! terms {
    ($($(#[$doc:meta])* $name:ident: $config:ty,)*) => {
        /// `[loss]` of a config: one table for each term of L = Σ weight · term. Means are over rays.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct LossConfig {
            $($(#[$doc])* pub $name: $config,)*
        }

        $(impl Weighted for $config {
            fn weight(&self) -> &Schedule {
                &self.weight
            }

            fn weight_mut(&mut self) -> &mut Schedule {
                &mut self.weight
            }
        })*

        impl LossConfig {
            /// Lists every term by name, in the order of reports.
            pub fn specs(&self) -> impl Iterator<Item = (&'static str, &dyn TermSpec)> {
                [$((stringify!($name), &self.$name as &dyn TermSpec),)*].into_iter()
            }

            /// Lists every term by name, mutable, in the order of reports.
            pub fn specs_mut(&mut self) -> impl Iterator<Item = (&'static str, &mut dyn TermSpec)> {
                [$((stringify!($name), &mut self.$name as &mut dyn TermSpec),)*].into_iter()
            }
        }
    };
}

// w are the weights of a ray's samples, α their opacities, A = Σ w.
terms! {
    /// L_RGB: mean ‖C − Ĉ‖² (InfoNeRF, Eq. 3).
    rgb: PhotometricConfig,
    /// λ₁ L_entropy: mean M(r) · −Σ p log₂ p, p = α/Σα, with M(r) 0 for rays that hit nothing (InfoNeRF, Eq. 4–8).
    entropy: EntropyConfig,
    /// λ₂ L_KL: mean KL(P(r) ‖ P(r̃)) of rays and their neighbours r̃ (InfoNeRF, Eq. 9).
    kl: KlConfig,
    /// 1 − φᵀφ̂ of the CLIP embeddings of a render and a training image (DietNeRF, Jain et al. 2021, Eq. 5).
    semantic: SemanticConfig,
    /// Mean ln(π + (1 − π) P)/ln π, P the probability that a ray ends at the depth that stereo matched.
    stereo: StereoConfig,
    /// Mean ln(0.1 + A) + ln(1.1 − A), 0 for A of 0 and 1 (Neural Volumes, Lombardi et al. 2019).
    opacity_prior: OpacityPriorConfig,
    /// Mean of A for pixels of the known background colour, and of −A for all others.
    silhouette: SilhouetteConfig,
    /// Total variation of a field's tables.
    tv: TvConfig,
    /// KL(N(μ, σ²) ‖ N(0, 1)) of a field's latent code (Neural Volumes).
    latent: LatentConfig,
}

impl LossConfig {
    /// Lists the terms whose weight is above 0 at some time of the run.
    pub fn active(&self) -> impl Iterator<Item = (&'static str, &dyn TermSpec)> {
        self.specs().filter(|(_, spec)| !spec.weight().is_zero())
    }

    /// Collects what the [active](Self::active) terms need rendered, each need once.
    pub fn needs(&self) -> Vec<Need> {
        union(self.active().flat_map(|(_, spec)| spec.needs()))
    }

    /// Checks every number of every term.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), Fault> {
        for (name, spec) in self.specs() {
            Fault::unless_always_within(0.0..=1e6, "weight", spec.weight())
                .and_then(|()| spec.validate())
                .map_err(|fault| fault.within(&format!("loss.{name}")))?;
        }
        Ok(())
    }
}

/// The active terms of a run, built for a scene.
pub struct Objective {
    terms: Vec<BuiltTerm>,
}

struct BuiltTerm {
    name: &'static str,
    weight: Schedule,
    needs: Vec<Need>,
    term: Box<dyn Term>,
}

/// Values of the terms of a step.
#[derive(Clone, Debug)]
pub struct LossValues {
    /// Σ weight · value, a scalar.
    pub total: Tensor<1>,
    /// Unweighted value of each term by name, scalars.
    pub values: Vec<(&'static str, Tensor<1>)>,
}

impl Objective {
    /// Builds the active terms for a field on `device`, except those that skip `scene` ([`TermSpec::skip_reason`]).
    ///
    /// # Errors
    /// If a term lacks what it needs.
    pub fn new(config: &LossConfig, scene: &Scene, device: &Device) -> Result<Self, Fault> {
        let build = |(name, spec): (&'static str, &dyn TermSpec)| {
            let term = spec.build(scene, device).map_err(|fault| fault.within(&format!("loss.{name}")))?;
            Ok(BuiltTerm { name, weight: spec.weight().clone(), needs: spec.needs(), term })
        };
        let taking_part = config.active().filter(|(_, spec)| spec.skip_reason(scene).is_none());
        Ok(Self { terms: taking_part.map(build).collect::<Result<_, _>>()? })
    }

    /// Lists the terms of the step at `at`, with their weights: those that are due and have a positive weight.
    fn due(&self, at: Moment) -> impl Iterator<Item = (&BuiltTerm, f32)> {
        let weighted = self.terms.iter().map(move |built| (built, built.weight.at(at) as f32));
        weighted.filter(move |(built, weight)| *weight > 0.0 && built.term.is_due(at))
    }

    /// Collects what the terms of the step at `at` need rendered, each need once.
    pub fn needs(&self, at: Moment) -> Vec<Need> {
        union(self.due(at).flat_map(|(built, _)| &built.needs).copied())
    }

    /// Evaluates the terms of the step at `at` on the renders that they need.
    pub fn values(&self, at: Moment, renders: &Renders) -> LossValues {
        let evaluate = |(built, weight): (&BuiltTerm, f32)| {
            let value = built.term.value(renders);
            ((built.name, value.clone()), (value, weight))
        };
        let (values, weighted) = self.due(at).map(evaluate).unzip();
        LossValues { total: weighted_sum(weighted).unwrap_or_else(|| renders.zero()), values }
    }
}

#[cfg(test)]
mod tests {
    use infonerf_field::Penalty;

    use super::*;
    use crate::testing::{config, scenario};

    /// Checks every need of every term, so that all that a term reads is rendered.
    #[test]
    fn each_term_declares_what_it_needs() {
        use Need::{SeenColor, SeenNeighbours, Unseen, UnseenNeighbours};
        let table = [
            ("rgb.weight = 1", vec![SeenColor]),
            ("entropy.weight = 1", vec![Unseen]),
            ("entropy = { weight = 1, rays = 'seen' }", vec![]),
            ("entropy = { weight = 1, neighbours = true }", vec![Unseen, SeenNeighbours, UnseenNeighbours]),
            ("kl.weight = 1", vec![Unseen, SeenNeighbours, UnseenNeighbours]),
            ("kl = { weight = 1, rays = 'seen' }", vec![SeenNeighbours]),
            ("kl = { weight = 1, rays = 'unseen' }", vec![Unseen, UnseenNeighbours]),
            ("semantic.weight = 1", vec![Need::Picture { size: 64 }]),
            ("stereo.weight = 1", vec![]),
            ("opacity_prior.weight = 1", vec![]),
            ("opacity_prior = { weight = 1, rays = 'all' }", vec![Unseen]),
            ("silhouette.weight = 1", vec![]),
            ("tv.weight = 1", vec![Need::Penalty(Penalty::TOTAL_VARIATION)]),
            ("latent.weight = 1", vec![Need::Penalty(Penalty::LATENT_DIVERGENCE)]),
        ];
        for (setting, needs) in table {
            let config = config(setting);
            let names: Vec<_> = config.active().map(|(name, _)| name).collect();
            assert_eq!(names, [setting.split(['.', ' ']).next().unwrap()]);
            assert_eq!(config.needs(), needs, "{setting}");
        }
        assert_eq!(config("").needs(), []);
        let both = config("rgb.weight = 1\nkl.weight = 1\nentropy.weight = 1");
        assert_eq!(both.needs(), [SeenColor, Unseen, SeenNeighbours, UnseenNeighbours]);
        let kinds = [SeenColor, Unseen, SeenNeighbours, UnseenNeighbours, Need::Picture { size: 64 }];
        assert_eq!(kinds.map(|need| need.is_unseen()), [false, true, false, true, true]);
        assert_eq!(kinds.map(|need| need.is_of_neighbours()), [false, false, true, true, false]);
    }

    /// Checks that only the silhouette is supervised by more than colours, and that only the semantic term reads a file.
    #[test]
    fn terms_name_their_files_and_what_supervises_them() {
        let mut config = config("");
        let supervised = config.specs().filter_map(|(name, spec)| Some((name, spec.extra_supervision()?)));
        assert_eq!(supervised.collect::<Vec<_>>(), [("silhouette", "the colour of the background")]);
        let files = config.specs_mut().filter_map(|(name, spec)| Some((name, spec.weights_file()?.0)));
        assert_eq!(files.collect::<Vec<_>>(), [("semantic", "weights")]);
    }

    #[test]
    fn keys_out_of_range_are_named() {
        assert_eq!(config("").validate(), Ok(()));
        for (setting, key) in [
            ("rgb.weight = -1", "loss.rgb.weight"),
            ("tv.weight = { from = 1.0, to = 2e6 }", "loss.tv.weight"),
            ("rgb.coarse = -1", "loss.rgb.coarse"),
            ("entropy.epsilon = 0.1", "loss.entropy.epsilon"),
            ("entropy.mask = { rule = 'acc', threshold = -1 }", "loss.entropy.mask.threshold"),
            ("kl.epsilon = 0", "loss.kl.epsilon"),
            ("semantic.every = 0", "loss.semantic.every"),
            ("semantic.size = 2000", "loss.semantic.size"),
        ] {
            assert_eq!(config(setting).validate().unwrap_err().key, key);
        }
    }

    /// Checks that terms are summed with the step's weights, and that a term of weight 0 is not evaluated.
    #[test]
    fn total_is_the_weighted_sum_of_due_terms() {
        let config = config("rgb.weight = 2\nopacity_prior.weight = { from = 0.0, to = 0.5 }");
        let (scene, device) = (Scene::default(), Device::flex());
        let objective = Objective::new(&config, &scene, &device).unwrap();
        let (_, renders) = scenario(&device);
        let values = |at: Moment| {
            let LossValues { total, values } = objective.values(at, &renders);
            let values: Vec<_> = values.into_iter().map(|(name, v)| (name, v.into_scalar::<f32>())).collect();
            (objective.needs(at), values, total.into_scalar::<f32>())
        };
        let (needs, first, total) = values(Moment::START);
        assert_eq!((needs, first.len(), first[0].0), (vec![Need::SeenColor], 1, "rgb"));
        assert_eq!(total, 2.0 * first[0].1);
        let (_, last, total) = values(Moment::END);
        assert_eq!(last.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["rgb", "opacity_prior"]);
        assert!(last.iter().all(|(_, value)| *value > 0.0));
        approx::assert_relative_eq!(total, 2.0 * last[0].1 + 0.5 * last[1].1, epsilon = 1e-6);
        let nothing = Objective { terms: Vec::new() };
        assert_eq!(nothing.values(Moment::END, &renders).total.into_scalar::<f32>(), 0.0);
    }

    /// Checks that a silhouette is left out of a scene whose background is unknown, with a reason.
    #[test]
    fn terms_that_skip_the_scene_are_left_out() {
        let config = config("rgb.weight = 1\nsilhouette.weight = 1");
        let scene = Scene { backdrop: infonerf_scene::Backdrop::Unknown, ..Scene::default() };
        let objective = Objective::new(&config, &scene, &Device::flex()).unwrap();
        assert_eq!(objective.terms.iter().map(|term| term.name).collect::<Vec<_>>(), ["rgb"]);
        let skipped = config.specs().filter(|(_, spec)| spec.skip_reason(&scene).is_some()).map(|(name, _)| name);
        assert_eq!(skipped.collect::<Vec<_>>(), ["stereo", "silhouette"], "the scene has no views either");
        assert_eq!(config.silhouette.skip_reason(&Scene::default()), None);
    }
}
