//! Numbers between the host and a device, and how many: a GPU waits for both.

use std::ops::{Add, Sub};
use std::sync::atomic::{AtomicU64, Ordering};

use burn::tensor::kind::Basic;
use burn::tensor::{Bool, Device, Element, Float, Int, Tensor, TensorData, Transaction};
use serde::Serialize;

use crate::Segments;
use crate::dispatch::dispatch;

/// A type of numbers on the host, and the kind of tensor that they make.
pub trait HostNumber: Element {
    /// The kind of tensor.
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

/// `values`, row-major, as a tensor of `shape` on `device`.
///
/// # Panics
/// If `shape` is of another number of values.
pub fn upload<E: HostNumber, const D: usize>(values: Vec<E>, shape: [usize; D], device: &Device) -> Tensor<D, E::Kind> {
    if values.is_empty() {
        return Tensor::empty(shape, device);
    }
    count_upload(size_of_val(values.as_slice()));
    Tensor::from_data(TensorData::new(values, shape), device)
}

/// Each of `arrays` as a tensor on `device`: on a GPU moved there at once, as parts of one buffer, together with what
/// operations along the rays of each of `segments` will ask for.
#[cfg_attr(not(feature = "cube"), allow(unused_variables, reason = "only kernels of GPUs ask for offsets"))]
pub fn upload_together<const N: usize>(
    arrays: [Vec<f32>; N],
    segments: &[&Segments],
    device: &Device,
) -> [Tensor<1>; N] {
    let one_by_one = |arrays: [Vec<f32>; N]| {
        arrays.map(|array| {
            let count = array.len();
            upload(array, [count], device)
        })
    };
    dispatch! {
        device;
        host => one_by_one(arrays),
        cube => crate::cube::together(arrays, segments, device),
        plain => one_by_one(arrays),
    }
}

/// Rows of `columns` numbers, copied to `device`.
pub fn from_host(rows: &[f32], columns: usize, device: &Device) -> Tensor<2> {
    upload(rows.to_vec(), [rows.len() / columns, columns], device)
}

/// A tensor's numbers on the host, row-major, in single precision.
pub fn to_host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    read(vec![tensor.into_data()])
}

/// The numbers of several tensors, one after the other, read at once: a GPU is waited for once.
pub fn to_host_together(tensors: impl IntoIterator<Item = Tensor<1>>) -> Vec<f32> {
    read(tensors.into_iter().fold(Transaction::default(), |all, tensor| all.register(tensor.inner())).execute())
}

fn read(data: Vec<TensorData>) -> Vec<f32> {
    count_read(data.iter().map(|data| data.bytes().len()).sum());
    let floats = |data: TensorData| data.convert::<f32>().try_to_vec().expect("the data were just converted to f32");
    let mut parts = data.into_iter().map(floats);
    let first = parts.next().unwrap_or_default();
    parts.fold(first, |mut all, part| {
        all.extend::<Vec<f32>>(part);
        all
    })
}

/// What has passed between the host and its devices; differences are of what passed in between.
///
/// Counted over all threads of the process, whatever the device: on a CPU an upload and a read cost next to nothing. Scalars
/// that are arguments of a kernel travel with its launch and are no uploads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Traffic {
    /// Tensors made of the host's numbers.
    pub uploads: u64,
    /// Their size.
    pub uploaded_bytes: u64,
    /// Tensors read back. A GPU has to finish what it was given before each.
    pub reads: u64,
    /// Their size.
    pub read_bytes: u64,
    /// Kernels launched on GPUs, Burn's and ours; 0 on CPUs.
    pub launches: u64,
}

impl Traffic {
    /// The counts so far. Launches are counted from the first call on.
    pub fn now() -> Self {
        #[cfg(feature = "cube")]
        launches::observe();
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Self {
            uploads: count(&COUNTERS.uploads),
            uploaded_bytes: count(&COUNTERS.uploaded_bytes),
            reads: count(&COUNTERS.reads),
            read_bytes: count(&COUNTERS.read_bytes),
            launches: count(&COUNTERS.launches),
        }
    }

    /// What passed in `steps`, as a line of means per step.
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

    fn zip(self, other: Self, with: fn(u64, u64) -> u64) -> Self {
        Self {
            uploads: with(self.uploads, other.uploads),
            uploaded_bytes: with(self.uploaded_bytes, other.uploaded_bytes),
            reads: with(self.reads, other.reads),
            read_bytes: with(self.read_bytes, other.read_bytes),
            launches: with(self.launches, other.launches),
        }
    }
}

impl Add for Traffic {
    type Output = Self;

    fn add(self, more: Self) -> Self {
        self.zip(more, u64::add)
    }
}

impl Sub for Traffic {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        self.zip(earlier, u64::sub)
    }
}

struct Counters {
    uploads: AtomicU64,
    uploaded_bytes: AtomicU64,
    reads: AtomicU64,
    read_bytes: AtomicU64,
    launches: AtomicU64,
}

static COUNTERS: Counters = Counters {
    uploads: AtomicU64::new(0),
    uploaded_bytes: AtomicU64::new(0),
    reads: AtomicU64::new(0),
    read_bytes: AtomicU64::new(0),
    launches: AtomicU64::new(0),
};

/// Counts an upload that does not go through [`upload`].
pub(crate) fn count_upload(bytes: usize) {
    COUNTERS.uploads.fetch_add(1, Ordering::Relaxed);
    COUNTERS.uploaded_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
}

/// Counts a read.
pub(crate) fn count_read(bytes: usize) {
    COUNTERS.reads.fetch_add(1, Ordering::Relaxed);
    COUNTERS.read_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
}

#[cfg(feature = "cube")]
mod launches {
    use std::sync::atomic::Ordering;
    use std::sync::{Arc, OnceLock};

    use burn::cubecl::logging::{LaunchObservation, LaunchObserver};

    struct Counter;

    impl LaunchObserver for Counter {
        fn launched(&self, _kernel: &'static str) {
            super::COUNTERS.launches.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Counts every launch of the process from the first call on.
    pub(super) fn observe() {
        static OBSERVATION: OnceLock<LaunchObservation> = OnceLock::new();
        OBSERVATION.get_or_init(|| LaunchObservation::new(Arc::new(Counter)));
    }
}
