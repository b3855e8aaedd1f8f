//! Sweeps on a real Slurm: `just test-slurm`.

#![cfg(unix)]

use std::process::{Command, Stdio};

use crate::common::{Workplace, records, text, wait_for, without_times};

fn slurm(program: &str, args: &[&str]) -> String {
    let output = Command::new(program).args(args).output().unwrap_or_else(|error| panic!("{program}: {error}"));
    assert!(output.status.success(), "{program} {args:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

#[test]
#[ignore = "needs Slurm: just test-slurm"]
fn a_requeued_item_goes_on_and_the_table_is_the_local_one() {
    let place = Workplace::new();
    let args = "sweep fast-losses --scene knot --variant infonerf --grid loss.entropy.weight=0,1e-4,1e-3,1e-2 \
                --grid loss.kl.weight=0,1e-5,1e-4,1e-3 --set train.iterations=1500 --set train.checkpoint_every=50";
    // The name has characters that scripts have to quote and Slurm has to take literally.
    let slurm_out = "a \"b\" 100%";
    let sweep = |out: &str, more: &str| place.tiny_without("train.iterations", args).args("--out").arg(out).args(more);
    let mut command = sweep(slurm_out, "--launch slurm --cpus 1 --jobs 2 --watch").into_command();
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).stdin(Stdio::null()).spawn().unwrap();
    let folder = place.path(slurm_out).join("sweep-fast-losses");
    wait_for(&folder.join("knot/infonerf_loss.entropy.weight_0_loss.kl.weight_1e-4/seed0/checkpoint/manifest.json"));
    let listed = slurm("squeue", &["--noheader", "--array", "--states=R", "--format=%i %o"]);
    let third = |line: &str| {
        let (id, command) = line.trim().split_once(' ')?;
        (id.ends_with("_2") && command.trim().ends_with("/items-0.sh")).then(|| id.to_owned())
    };
    let task = listed.lines().find_map(third).unwrap_or_else(|| panic!("the third item does not run: {listed}"));
    slurm("scontrol", &["requeue", &task]);
    let output = child.wait_with_output().unwrap();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success() && stdout.contains("16 runs submitted as slurm"), "{stdout}{stderr}");
    let shown = slurm("scontrol", &["show", "job", &task]);
    assert!(shown.contains("Restarts=1"), "{shown}");
    assert!(folder.join("launch/merge.sh").exists());
    sweep("local", "--jobs 2").succeeds();
    let numbers = |out: &str| without_times(&records(&place.path(out).join("sweep-fast-losses")));
    assert_eq!(numbers(slurm_out).len(), 16);
    assert_eq!(numbers(slurm_out), numbers("local"));
}
