use infonerf_schedule::Fault;
use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};

/// Reads the vertices of a PLY file, at least one and all finite.
pub(super) fn read(path: &Path) -> Result<Vec<[f32; 3]>, Fault> {
    let fault = |cause: String| {
        Fault::new("field.vertices", "a PLY file with finite vertices", format!("{}: {cause}", path.display()))
    };
    let one_line = |error: Box<dyn Error>| error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    let vertices = of_ply(path).map_err(|error| fault(one_line(error)))?;
    if vertices.is_empty() || !vertices.as_flattened().iter().all(|x| x.is_finite()) {
        return Err(fault("none, or one that is not finite".into()));
    }
    Ok(vertices)
}

fn of_ply(path: &Path) -> Result<Vec<[f32; 3]>, Box<dyn Error>> {
    let ply = Parser::<DefaultElement>::new().read_ply(&mut BufReader::new(File::open(path)?))?;
    let along = |vertex: &DefaultElement, axis: &str| match vertex.get(axis) {
        Some(&Property::Float(x)) => Ok(x),
        Some(&Property::Double(x)) => Ok(x as f32),
        _ => Err(format!("a vertex without a float or double `{axis}`")),
    };
    let vertices = ply.payload.get("vertex").map_or(&[][..], Vec::as_slice);
    let vertex = |v| Ok([along(v, "x")?, along(v, "y")?, along(v, "z")?]);
    Ok(vertices.iter().map(vertex).collect::<Result<_, String>>()?)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn ply_files_are_read_or_refused_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            path
        };
        let ply = |third: &str| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty double y\nproperty float z\n\
                 end_header\n0 0 0\n1 0 0.5\n0 1 {third}\n"
            )
        };
        let expected = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 1.0, -2.0]];
        assert_eq!(read(&file("body.ply", &ply("-2"))).unwrap(), expected);
        for (path, cause) in [
            (file("infinite.ply", &ply("1e39")), "not finite"),
            (file("word.ply", &ply("two")), "word.ply"),
            (file("cut.ply", &ply("-2")[..60]), "cut.ply"),
            (file("empty.ply", &ply("-2").replace("vertex", "point")), "none"),
            (file("body.obj", "v 0 0 0\n"), "body.obj"),
            (folder.path().join("absent.ply"), "absent.ply"),
        ] {
            let message = read(&path).unwrap_err().to_string();
            assert!(message.starts_with("field.vertices: expected a PLY file"), "{message}");
            assert!(message.contains(cause) && message.lines().count() == 1, "{message}");
        }
    }
}
