//! Comparison of folders of images: values as in memory, and errors of one line.

use std::path::PathBuf;

use crate::common::pictures;
use image::{Rgba, RgbaImage};
use infonerf_metrics::protocol::Background;
use infonerf_metrics::{
    ComparedFolders, Folders, METRICS, Mask, MetricError, Networks, Pair, Picture, Protocol, compare_folders, evaluate,
    select, to_rgb8,
};

struct Workspace(tempfile::TempDir);

impl Workspace {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        ["renders", "truth", "masks"].iter().for_each(|name| std::fs::create_dir(folder.path().join(name)).unwrap());
        Self(folder)
    }

    fn path(&self, file: &str) -> PathBuf {
        self.0.path().join(file)
    }

    fn write(&self, file: &str, picture: &Picture) {
        let [width, height] = picture.size().map(|side| side as u32);
        to_rgb8(picture.pixels(), width, height).unwrap().save(self.path(file)).unwrap();
    }

    fn pair(&self, name: &str, width: usize, height: usize) -> (Picture, Picture) {
        let (render, truth) = pictures(width, height);
        self.write(&format!("renders/{name}.png"), &render);
        self.write(&format!("truth/{name}.png"), &truth);
        (render, truth)
    }

    /// Writes a mask: inside where `class` is not 0. Pixels outside are black in even columns, transparent in odd ones.
    fn mask(&self, name: &str, width: u32, height: u32, class: impl Fn(u32, u32) -> u8) {
        let outside = |x| if x % 2 == 0 { Rgba([0, 0, 0, 255]) } else { Rgba([255, 255, 255, 0]) };
        let pixel = |x, class| if class == 0 { outside(x) } else { Rgba([class, class, class, 255]) };
        let image = RgbaImage::from_fn(width, height, |x, y| pixel(x, class(x, y)));
        image.save(self.path(&format!("masks/{name}.png"))).unwrap();
    }

    fn compare(&self, masks: bool, protocol: Protocol) -> Result<ComparedFolders, MetricError> {
        let (renders, truth, masks_folder) = (self.path("renders"), self.path("truth"), self.path("masks"));
        let masks = masks.then_some(masks_folder.as_path());
        let folders = Folders { renders: &renders, truth: &truth, masks, partial: false };
        compare_folders(folders, METRICS, &Networks::none(), &protocol, |_, _| {})
    }

    fn fault(&self, masks: bool) -> String {
        let line = self.compare(masks, Protocol::default()).unwrap_err().to_string();
        let folder = format!("{}/", self.0.path().display());
        assert!(line.contains(&folder) && !line.contains('\n'), "{line}");
        line.replace(&folder, "")
    }
}

#[test]
fn folders_and_images_in_memory_have_the_same_values() {
    let workspace = Workspace::new();
    let sizes = [("a", 16, 12), ("b", 20, 15), ("c", 13, 30)];
    let written: Vec<(Picture, Picture)> = sizes.iter().map(|(name, w, h)| workspace.pair(name, *w, *h)).collect();
    std::fs::write(workspace.path("renders/notes.txt"), "not a picture").unwrap();
    for (name, width, height) in sizes {
        workspace.mask(name, width as u32, height as u32, |x, _| u8::from(x > 3));
    }
    let inside = |w: usize, h: usize| Mask::new((0..w * h).map(|i| i % w > 3).collect(), w, h).unwrap();
    let masks: Vec<Mask> = sizes.iter().map(|(_, w, h)| inside(*w, *h)).collect();
    let pairs: Vec<Pair<'_>> =
        written.iter().zip(&masks).map(|((x, y), mask)| Pair { mask: Some(mask), ..Pair::new(x, y) }).collect();
    let expected = evaluate(&pairs, &Networks::none(), &Protocol::default()).unwrap();

    let mut steps = Vec::new();
    let (renders, truth, masks) = (workspace.path("renders"), workspace.path("truth"), workspace.path("masks"));
    let folders = Folders { renders: &renders, truth: &truth, masks: Some(&masks), partial: false };
    let report = |done, all| steps.push((done, all));
    let compared = compare_folders(folders, METRICS, &Networks::none(), &Protocol::default(), report).unwrap();
    assert_eq!(compared.measured, expected);
    assert_eq!(compared.views.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c"]);
    assert_eq!(compared.views[1].mask, Some(masks.join("b.png")));
    assert_eq!(steps, [(0, 3), (1, 3), (2, 3), (3, 3)]);
}

#[test]
fn transparent_pixels_show_the_background() {
    let workspace = Workspace::new();
    let half = RgbaImage::from_pixel(12, 12, Rgba([255, 0, 0, 51]));
    half.save(workspace.path("renders/a.png")).unwrap();
    for (background, expected) in [(Background::White, [255, 204, 204]), (Background::Black, [51, 0, 0])] {
        let truth = image::RgbImage::from_pixel(12, 12, image::Rgb(expected));
        truth.save(workspace.path("truth/a.png")).unwrap();
        let compared = workspace.compare(false, Protocol { background, ..Protocol::default() }).unwrap();
        assert_eq!(compared.measured.set["psnr"], Some(f64::INFINITY));
    }
}

#[test]
fn jpeg_is_read_and_partial_leaves_out_images_without_a_render() {
    let workspace = Workspace::new();
    let (render, truth) = workspace.pair("a", 32, 32);
    std::fs::remove_file(workspace.path("truth/a.png")).unwrap();
    workspace.write("truth/a.JPG", &render);
    std::fs::rename(workspace.path("renders/a.png"), workspace.path("renders/a.jfif")).unwrap();
    workspace.write("truth/b.png", &truth);
    let (renders, truth) = (workspace.path("renders"), workspace.path("truth"));
    let folders = Folders { renders: &renders, truth: &truth, masks: None, partial: true };
    let metrics = select(["psnr"]).unwrap();
    let compared = compare_folders(folders, &metrics, &Networks::none(), &Protocol::default(), |_, _| {}).unwrap();
    assert_eq!((compared.views.len(), compared.measured.set.len()), (1, 1));
    assert!(compared.measured.set["psnr"].unwrap() > 10.0);
}

#[test]
fn webp_tiff_and_bmp_are_read_as_png_is() {
    let workspace = Workspace::new();
    let (render, truth) = workspace.pair("a", 32, 32);
    workspace.mask("a", 32, 32, |x, _| u8::from(x > 9));
    let expected = workspace.compare(true, Protocol::default()).unwrap().measured;
    for (extension, is_mask) in [("webp", false), ("tif", true), ("TIFF", true), ("bmp", true)] {
        let other = Workspace::new();
        other.write(&format!("renders/a.{extension}"), &render);
        other.write(&format!("truth/a.{extension}"), &truth);
        let mask = image::open(workspace.path("masks/a.png")).unwrap();
        mask.save(other.path(&format!("masks/a.{}", if is_mask { extension } else { "png" }))).unwrap();
        assert_eq!(other.compare(true, Protocol::default()).unwrap().measured, expected, "{extension}");
    }
}

#[test]
fn missing_partners_are_named() {
    let workspace = Workspace::new();
    assert_eq!(workspace.fault(false), "renders: no PNG, JPEG, WebP, TIFF or BMP images in it");
    let (render, _) = workspace.pair("a", 12, 12);
    workspace.write("renders/b.png", &render);
    assert_eq!(workspace.fault(false), "renders/b.png has no truth in truth: expected an image called `b`");
    std::fs::rename(workspace.path("renders/b.png"), workspace.path("truth/b.png")).unwrap();
    assert_eq!(workspace.fault(false), "truth/b.png has no render in renders: expected an image called `b`");
    std::fs::remove_file(workspace.path("truth/b.png")).unwrap();
    workspace.mask("c", 12, 12, |_, _| 1);
    assert_eq!(workspace.fault(true), "renders/a.png has no mask in masks: expected an image called `a`");
    workspace.write("truth/a.jpeg", &render);
    assert_eq!(workspace.fault(false), "truth/a.jpeg and truth/a.png have the same name");
    std::fs::remove_dir_all(workspace.path("masks")).unwrap();
    std::fs::remove_file(workspace.path("truth/a.jpeg")).unwrap();
    assert!(workspace.fault(true).starts_with("masks: No such file"), "{}", workspace.fault(true));
}

#[test]
fn unsuitable_sizes_and_masks_are_named() {
    let workspace = Workspace::new();
    let (_, truth) = workspace.pair("a", 24, 16);
    let (small, _) = pictures(12, 8);
    workspace.write("renders/a.png", &small);
    assert_eq!(workspace.fault(false), "renders/a.png: the truth has 24×16 pixels, the render 12×8");
    workspace.write("renders/a.png", &truth);
    workspace.mask("a", 24, 16, |_, _| 0);
    let masked = workspace.compare(true, Protocol::default()).unwrap().measured;
    assert!(masked.set["psnr"].is_some() && masked.set["psnr_masked"].is_none());
    assert!(masked.notes.iter().any(|note| note.reason == "the mask is empty: no pixel is inside"));
    workspace.mask("a", 24, 15, |_, _| 1);
    assert_eq!(workspace.fault(true), "renders/a.png: the mask has 24×15 pixels, the render 24×16");
    std::fs::remove_file(workspace.path("masks/a.png")).unwrap();
    workspace.write("masks/a.jpg", &truth);
    let expected = "masks/a.jpg: a mask is a PNG, TIFF or BMP: JPEG and WebP need not keep black exactly";
    assert_eq!(workspace.fault(true), expected);
}

#[test]
fn broken_images_are_named() {
    let workspace = Workspace::new();
    let (_, truth) = workspace.pair("a", 24, 16);
    for name in ["truth/a.png", "truth/a.jpg"] {
        workspace.write(name, &truth);
        let file = workspace.path(name);
        let bytes = std::fs::read(&file).unwrap();
        for length in [0, 10, bytes.len() - 20] {
            std::fs::write(&file, &bytes[..length]).unwrap();
            let line = workspace.fault(false);
            assert!(line.starts_with(&format!("{name}: ")), "{length}: {line}");
        }
        std::fs::remove_file(file).unwrap();
    }
}
