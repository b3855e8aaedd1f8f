//! Pictures of normals.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use glam::Vec3;
use infonerf_field::{Field, FieldOutput, Points, density_gradient};
use infonerf_scene::{Backdrop, Camera};
use infonerf_schedule::Moment;

use crate::image::{RenderedImage, combine, render_one};
use crate::model::{Model, TrainedModel};
use crate::renderer::Renderer;
use crate::warp::Warp;

/// Renders the picture of normals that `camera` sees. In place of colour it has Σ w n in the camera's axes (x right, y
/// up, z towards the camera), with compositing weights w and n = −∇σ/|∇σ| in the world, 0 where ∇σ = 0. It is the mean of
/// all members' pictures.
///
/// # Panics
/// If there are no members, or a field that does not [track positions](infonerf_field::FieldTraits::tracks_positions).
pub fn render_normals<F: Field>(renderer: &Renderer, members: &[TrainedModel<F>], camera: &Camera) -> RenderedImage {
    let black = Renderer { background: [0.0; 3], backdrop: Backdrop::Colour, ..renderer.clone() };
    let of_member = |member: &TrainedModel<F>| {
        let normals = |field: &F| Normals { field: field.clone(), warp: renderer.warp().clone() };
        let coarse = member.model.coarse.as_ref().map(normals);
        let model = Model { coarse, ..Model::of(normals(&member.model.fine)) };
        let occupancy = member.occupancy.clone();
        let trained = TrainedModel { occupancy, frame: member.frame, ..TrainedModel::of(model, member.at) };
        let mut image = render_one(&black, &trained, camera, None);
        let to_camera = member.camera(camera).rotation().transpose().as_mat3();
        image.rgb.iter_mut().for_each(|normal| *normal = (to_camera * Vec3::from(*normal)).to_array());
        image
    };
    combine(members.iter().map(of_member).collect())
}

/// A field whose colours are its normals in the world.
#[derive(Module, Debug)]
struct Normals<F: Module> {
    field: F,
    #[module(skip)]
    warp: Warp,
}

impl<F: Field> Field for Normals<F> {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        if !color {
            return self.field.evaluate(points, false, at);
        }
        let (sigma, gradient) = density_gradient(&self.field, points, at).expect("the field tracks positions");
        let gradient = self.warp.world_gradient(&points.positions, gradient);
        let steepness: Tensor<2> = gradient.clone().square().sum_dim(1).sqrt().clamp_min(f32::MIN_POSITIVE);
        FieldOutput { sigma, color: Some(gradient.neg() / steepness) }
    }

    fn device(&self) -> Device {
        self.field.device()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat4, DVec3};
    use infonerf_ops::sampling::Placement;
    use infonerf_ops::upload;
    use infonerf_scene::{Backdrop, Scene, Similarity};

    use super::*;
    use crate::image::tests::config;
    use crate::model::ModelFrame;
    use crate::warp::SpaceChoice;

    /// A ball in the space of a warp: σ = 50·softplus(300 (1 − |p − centre|)).
    #[derive(Module, Debug)]
    struct BallField {
        none: Tensor<1>,
        #[module(skip)]
        centre: Vec3,
    }

    impl Field for BallField {
        fn evaluate(&self, points: &Points, _color: bool, _at: Moment) -> FieldOutput {
            let centre: Tensor<2> = upload(self.centre.to_array().to_vec(), [1, 3], &self.device());
            let distance = (points.positions.clone() - centre).square().sum_dim(1).sqrt().squeeze_dim(1);
            let sigma = burn::tensor::activation::softplus((distance.neg() + 1.0) * 300.0, 1.0) * 50.0;
            FieldOutput { sigma, color: None }
        }

        fn device(&self) -> Device {
            self.none.device()
        }
    }

    /// Renders a unit sphere from a side, with a ray through the middle of each of 9 × 9 pixels: its normals are its
    /// points. A model in a turned frame gives the same normals.
    #[test]
    fn normals_of_a_sphere_are_its_points() {
        let rotation = glam::DMat3::from_rotation_x(0.3);
        let similarity = Similarity { rotation, scale: 1.0, translation: DVec3::ZERO };
        let turned = Some(ModelFrame { similarity, zoom: 1.0 });
        let to_world = DMat4::from_rotation_y(0.7) * DMat4::from_translation(DVec3::new(0.0, 0.0, 4.0));
        let camera = Camera::from_fov(9, 9, 0.6, to_world);
        let scene = Scene { background: [1.0; 3], backdrop: Backdrop::Unknown, ..Scene::default() };
        for (placement, frame) in [(Placement::Mid, None), (Placement::Left, turned)] {
            let config = crate::RenderConfig { samples: 512.0.into(), ..config(placement) };
            let renderer = Renderer::new(&config, &scene);
            let ball = BallField { none: Tensor::zeros([1], &Device::flex()), centre: Vec3::ZERO };
            let trained = TrainedModel { frame, ..TrainedModel::of(Model::of(ball), Moment::END) };
            let image = render_normals(&renderer, &[trained.clone(), trained], &camera);
            for (pixel, (normal, &acc)) in image.rgb.iter().zip(&image.acc).enumerate() {
                let ray = camera.ray((pixel % 9) as f32 + 0.5, (pixel / 9) as f32 + 0.5);
                let (along, normal) = (-ray.origin.dot(ray.direction), Vec3::from(*normal));
                let across = ray.at(along).length();
                if across > 1.2 {
                    assert!(normal.length() < 1e-3 && acc < 1e-3, "{pixel}: {normal}, {acc}");
                } else if across < 0.9 {
                    let met = ray.at(along - (1.0 - across * across).sqrt());
                    let want = camera.rotation().as_mat3().transpose() * met;
                    assert!(normal.distance(want) < 0.03, "{placement:?}, {pixel}: {normal} for {want}");
                }
            }
        }
    }

    /// Renders a ball that is a sphere in contracted space: its normals in the world differ from the gradient in that space.
    #[test]
    fn normals_are_those_of_the_world() {
        let mut scene = Scene::default();
        scene.space.bounded = false;
        let config =
            crate::RenderConfig { space: SpaceChoice::Contraction, samples: 2048.0.into(), ..config(Placement::Left) };
        let renderer = Renderer::new(&config, &scene);
        let warp = renderer.warp();
        let field = BallField { none: Tensor::zeros([1], &Device::flex()), centre: Vec3::new(0.0, 1.2, 0.0) };
        let density = |p: Vec3| -f64::from(warp.point(p).distance(field.centre));
        let camera = Camera::from_fov(1, 1, 0.1, DMat4::from_translation(DVec3::new(0.5, 3.0, 9.0)));
        let trained = TrainedModel::of(Model::of(field.clone()), Moment::END);
        let image = render_normals(&renderer, &[trained], &camera);
        let met = camera.ray(0.5, 0.5).at(image.depth[0]);
        let gradient = Vec3::AXES.map(|axis| (density(met + 1e-2 * axis) - density(met - 1e-2 * axis)) as f32);
        let want = camera.rotation().as_mat3().transpose() * -Vec3::from(gradient).normalize();
        assert!(Vec3::from(image.rgb[0]).distance(want) < 0.02, "{:?} for {want} at {met}", image.rgb[0]);
        let own = (warp.point(met) - field.centre).normalize();
        assert!(own.distance(want) > 0.05, "the warp matters: {own}, {want}");
    }
}
