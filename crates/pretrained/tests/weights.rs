//! Weight files: both of PyTorch's formats, broken files, and importing.

use crate::common::{values_of, write_weights};
use infonerf_metrics::{METRICS, select};
use infonerf_pretrained::{InceptionConfig, KnownWeights, LpipsConfig, Store, WeightFile};

/// Files in PyTorch's formats since and before version 1.6; `files.py` made both.
const HEADS: [(&str, &[u8]); 2] =
    [("heads.pth", include_bytes!("heads.pth")), ("heads_legacy.pth", include_bytes!("heads_legacy.pth"))];

#[test]
fn errors_of_broken_files_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let safetensors = folder.path().join("good");
    write_weights(&safetensors, &LpipsConfig::alex().head_tensors());
    let safetensors = std::fs::read(&safetensors).unwrap();
    let fault = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        // A PyTorch file is read when a tensor is requested.
        let file = WeightFile::read(&path)?;
        let tensors = LpipsConfig::alex().head_tensors();
        tensors.iter().try_for_each(|(name, shape)| file.floats(name, shape).map(drop))
    };
    for bytes in [&safetensors[..], HEADS[0].1, HEADS[1].1] {
        assert_eq!(fault(bytes), Ok(()));
        for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
            let line = fault(&bytes[..length]).expect_err("a truncated file");
            assert!(!line.contains('\n') && !line.is_empty(), "{line}");
        }
        for at in (0..bytes.len().min(1500)).step_by(7) {
            let mut other = bytes.to_vec();
            other[at] ^= 0x5a;
            if let Err(line) = fault(&other) {
                assert!(!line.contains('\n'), "{line}");
            }
        }
    }
    assert!(fault(b"some text").unwrap_err().contains(": no safetensors file, and no PyTorch file either: "));
    assert!(fault(b"12345678{").unwrap_err().contains(": no safetensors file: "));
}

#[test]
fn values_that_are_not_finite_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    write_weights(&path, &[("a".to_owned(), vec![4])]);
    let mut bytes = std::fs::read(&path).unwrap();
    let end = bytes.len();
    bytes[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    let fault = WeightFile::read(&path).unwrap().floats("a", &[4]);
    assert_eq!(fault, Err(format!("{}: `a` is not finite at index 3", path.display())));
}

#[test]
fn import_recognises_weights_by_their_tensors() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::in_folder(folder.path().join("weights"));
    assert!(store.status().all(|(_, path)| path.is_none()));
    for (name, bytes) in HEADS {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let imported = store.import(&path).unwrap();
        let [(weights, path)] = imported.as_slice() else { panic!("{imported:?}") };
        assert_eq!(weights.name, "lpips-alex-heads");
        assert_eq!(path, &folder.path().join("weights/lpips-alex-heads.safetensors"));
        let file = WeightFile::read(path).unwrap();
        for (name, shape) in LpipsConfig::alex().head_tensors() {
            assert_eq!(file.floats(&name, &shape).unwrap(), values_of(&name, &shape));
        }
    }
    let found = store.status().filter(|(_, path)| path.is_some()).map(|(weights, _)| weights.name);
    assert!(found.eq(["lpips-alex-heads"]));
    let files = std::fs::read_dir(folder.path().join("weights")).unwrap();
    assert_eq!(files.count(), 1, "nothing else is left there");
}

#[test]
fn import_keeps_only_needed_tensors_and_needs_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = (folder.path().join("all"), Store::in_folder(folder.path()));
    let other = ("classifier.weight".to_owned(), vec![10, 3]);
    write_weights(&path, &[LpipsConfig::vgg().head_tensors(), vec![other]].concat());
    // A file stands where the folder should be.
    let error = Store::in_folder(&path).import(&path).unwrap_err().to_string();
    assert!(error.starts_with(&format!("{}: ", path.display())), "{error}");
    let imported = store.import(&path).unwrap();
    assert!(WeightFile::read(&imported[0].1).unwrap().check("classifier.weight", &[10, 3]).is_err());
}

#[test]
fn unknown_weights_are_refused_with_the_missing_tensor() {
    let folder = tempfile::tempdir().unwrap();
    let (path, store) = (folder.path().join("file"), Store::in_folder(folder.path().join("weights")));
    let fault = |tensors: &[(String, Vec<usize>)]| {
        write_weights(&path, tensors);
        store.import(&path).unwrap_err().to_string()
    };
    let mut tensors = LpipsConfig::vgg().head_tensors();
    tensors.pop();
    let expected = "none of the known weights: most like lpips-vgg-heads, but no tensor `lin4.model.1.weight`, expected F32 \
                    [1, 512, 1, 1]";
    assert_eq!(fault(&tensors), format!("{}: {expected}", path.display()));
    let expected = "none of the known weights: it has no tensor that a known network has";
    assert_eq!(fault(&[("weight".to_owned(), vec![2])]), format!("{}: {expected}", path.display()));
    assert!(!folder.path().join("weights").exists());
    let absent = folder.path().join("absent");
    assert!(store.import(&absent).unwrap_err().to_string().starts_with(&format!("{}: No such file", absent.display())));
}

#[test]
fn networks_are_read_if_needed_and_present() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::in_folder(folder.path());
    let device = burn::tensor::Device::flex();
    let names = |keys: &[&str]| {
        let metrics = select(keys.iter().copied()).unwrap();
        format!("{:?}", store.networks(&metrics, &device).unwrap())
    };
    let all: Vec<&str> = METRICS.iter().map(|metric| metric.key()).collect();
    assert_eq!(names(&all), "{}");
    let write = |name: &str, config: &[(String, Vec<usize>)]| {
        write_weights(&folder.path().join(KnownWeights::named(name).unwrap().file()), config);
    };
    write("lpips-alex", &LpipsConfig::alex().backbone_tensors());
    assert_eq!(names(&all), "{}", "the heads are missing");
    let networks = store.networks(METRICS, &device).unwrap();
    let fault = networks.distance("lpips-alex").err().unwrap().to_string();
    assert!(fault.starts_with("no weights of lpips-alex-heads;"), "{fault}");
    assert!(fault.ends_with("fetch lpips-alex-heads`"), "{fault}");
    write("lpips-alex-heads", &LpipsConfig::alex().head_tensors());
    write("inception-fid", &InceptionConfig::FULL.tensors());
    assert_eq!(names(&["psnr", "lpips_alex_masked"]), r#"{"lpips-alex"}"#);
    assert_eq!(names(&all), r#"{"lpips-alex", "inception-fid"}"#);
    // A broken file is not a missing one.
    write("lpips-alex-heads", &LpipsConfig::vgg().head_tensors());
    let error = store.networks(METRICS, &device).unwrap_err().to_string();
    assert!(error.contains("lpips-alex-heads.safetensors: `lin1.model.1.weight` is F32 [1, 128, 1, 1]"), "{error}");
}

#[test]
fn explicit_files_and_folders_are_searched() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("anything.bin");
    let heads = KnownWeights::named("lpips-alex-heads").unwrap();
    write_weights(&path, &LpipsConfig::alex().head_tensors());
    assert_eq!(Store::new(Some(&path)).unwrap().find(heads), Some(path.clone()));
    let in_folder = Store::new(Some(folder.path())).unwrap();
    assert_ne!(in_folder.find(heads), Some(path.clone()), "folders are searched by name");
    let published = folder.path().join(heads.published_file());
    std::fs::rename(&path, &published).unwrap();
    assert_eq!(in_folder.find(heads), Some(published));
    assert!(Store::new(Some(&path)).unwrap_err().to_string().contains("anything.bin: No such file"));
}
