//! Transfers between the host and devices, and counts of them. A GPU waits for transfers in both directions.

use std::ops::Sub;
use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::kind::Basic;
use burn::tensor::{Bool, Device, Element, Float, Int, Tensor, TensorData, Transaction};
use serde::Serialize;

use crate::dispatch::dispatch;
use crate::segments::Segments;

/// Element type on the host, with the kind of its tensors.
pub trait HostNumber: Element {
    /// Kind of tensor.
    type Kind: Basic;
}

impl HostNumber for f32 {
    type Kind = Float;
}

impl HostNumber for i32 {
    type Kind = Int;
}

impl HostNumber for bool {
    type Kind = Bool;
}

/// Uploads `values`, row-major, as a tensor of `shape` on `device`.
///
/// # Panics
/// If the number of elements of `shape` differs from the number of values.
pub fn upload<E: HostNumber, const D: usize>(values: Vec<E>, shape: [usize; D], device: &Device) -> Tensor<D, E::Kind> {
    if values.is_empty() {
        assert!(shape.contains(&0), "no values for the shape {shape:?}");
        return Tensor::empty(shape, device);
    }
    count_upload(size_of_val(values.as_slice()));
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// Uploads each of `arrays` as a tensor; to a GPU all at once, as parts of one buffer that also holds the offsets of `segments`.
#[cfg_attr(not(feature = "cube"), allow(unused_variables, reason = "only kernels of GPUs ask for offsets"))]
pub fn upload_together<const N: usize>(
    arrays: [Vec<f32>; N],
    segments: &[&Segments],
    device: &Device,
) -> [Tensor<1>; N] {
    dispatch! {
        device;
        cube => crate::cube::buffers::upload_together(arrays, segments, device),
        plain => arrays.map(|array| {
            let count = array.len();
            upload(array, [count], device)
        }),
    }
}

/// Uploads `rows`, of `columns` elements each, as by [`upload`].
pub fn upload_rows(rows: &[f32], columns: usize, device: &Device) -> Tensor<2> {
    upload(rows.to_vec(), [rows.len() / columns, columns], device)
}

/// Reads a tensor's elements, row-major, in single precision.
pub fn to_host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    read(vec![tensor.into_data()])
}

/// Reads the elements of several tensors, one after the other, waiting for a GPU once.
pub fn to_host_together(tensors: impl IntoIterator<Item = Tensor<1>>) -> Vec<f32> {
    read(tensors.into_iter().fold(Transaction::default(), |all, tensor| all.register(tensor.inner())).execute())
}

fn read(data: Vec<TensorData>) -> Vec<f32> {
    let bytes: usize = data.iter().map(|data| data.bytes().len()).sum();
    COUNTERS[2].fetch_add(1, Ordering::Relaxed);
    COUNTERS[3].fetch_add(bytes as u64, Ordering::Relaxed);
    let floats = |data: TensorData| data.convert::<f32>().try_to_vec().expect("the data were just converted to f32");
    let mut parts: Vec<Vec<f32>> = data.into_iter().map(floats).collect();
    if parts.len() == 1 { parts.remove(0) } else { parts.concat() }
}

/// Counts of transfers and launches; the difference of two counts is the traffic in between.
///
/// Transfers and launches of all threads of the process are counted, whatever the device: on a CPU an upload and a read
/// cost next to nothing. Scalar arguments of a kernel travel with its launch and are no uploads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Tensors uploaded.
    pub uploads: u64,
    /// Bytes uploaded.
    pub uploaded_bytes: u64,
    /// Tensors read back. A GPU finishes all earlier work before each read.
    pub reads: u64,
    /// Bytes read back.
    pub read_bytes: u64,
    /// Kernels launched on GPUs, of Burn and of this crate; 0 on CPUs.
    pub launches: u64,
}

impl Traffic {
    /// Returns the counts so far. Launches are counted from the first call on.
    pub fn now() -> Self {
        #[cfg(feature = "cube")]
        launches::observe();
        let [uploads, uploaded_bytes, reads, read_bytes, launches] =
            COUNTERS.each_ref().map(|counter| counter.load(Ordering::Relaxed));
        Self { uploads, uploaded_bytes, reads, read_bytes, launches }
    }

    /// Formats the traffic of `steps` as means per step.
    pub fn per_step(&self, steps: usize) -> String {
        let mean = |count: u64| count as f64 / steps.max(1) as f64;
        let bytes = |count: u64| match mean(count) {
            bytes if bytes < 1e3 => format!("{bytes:.0} B"),
            bytes if bytes < 1e6 => format!("{:.1} kB", bytes / 1e3),
            bytes => format!("{:.1} MB", bytes / 1e6),
        };
        format!(
            "{:.1} launches, {:.1} uploads ({}), {:.1} reads ({})",
            mean(self.launches),
            mean(self.uploads),
            bytes(self.uploaded_bytes),
            mean(self.reads),
            bytes(self.read_bytes)
        )
    }
}

impl Sub for Traffic {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Self {
            uploads: self.uploads - earlier.uploads,
            uploaded_bytes: self.uploaded_bytes - earlier.uploaded_bytes,
            reads: self.reads - earlier.reads,
            read_bytes: self.read_bytes - earlier.read_bytes,
            launches: self.launches - earlier.launches,
        }
    }
}

/// Uploads, uploaded bytes, reads, read bytes and launches.
static COUNTERS: [AtomicU64; 5] = [const { AtomicU64::new(0) }; 5];

/// Counts an upload that does not go through [`upload`].
pub(crate) fn count_upload(bytes: usize) {
    COUNTERS[0].fetch_add(1, Ordering::Relaxed);
    COUNTERS[1].fetch_add(bytes as u64, Ordering::Relaxed);
}

#[cfg(feature = "cube")]
mod launches {
    use std::sync::atomic::Ordering;
    use std::sync::{Arc, OnceLock};

    use burn::cubecl::logging::{LaunchObservation, LaunchObserver};

    struct Counter;

    impl LaunchObserver for Counter {
        fn launched(&self, _kernel: &'static str) {
            super::COUNTERS[4].fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Counts every launch of the process from the first call on.
    pub(super) fn observe() {
        static OBSERVATION: OnceLock<LaunchObservation> = OnceLock::new();
        OBSERVATION.get_or_init(|| LaunchObservation::new(Arc::new(Counter)));
    }
}
