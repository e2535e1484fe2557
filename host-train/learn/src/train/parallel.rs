//! A step on several devices. Each has a copy of the network. Gradients and running statistics are combined on the first device.
//!
//! ```text
//! weights ──> copy on device 0 ── its micro-batches ──> gradients, running statistics ──┐
//!        └──> copy on device 1 ── its micro-batches ──> gradients, running statistics ──┴─> sums and means ──> optimiser
//! ```
//!
//! Gradients are added in the devices' order, so the same devices give the same weights. Batch normalisation uses one micro-batch at a
//! time, as with `accumulate`. Its running statistics are the means of the copies' statistics.

use crate::model::elunar::ELunarDtmNet;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use elunar_base::{Error, Result};

/// Devices, each with a part of the processor's threads.
pub(super) struct DeviceGroup {
    members: Vec<(Device, rayon::ThreadPool)>,
}

impl DeviceGroup {
    /// Makes a group of these devices. Each device must support gradients.
    ///
    /// # Errors
    /// If threads cannot be created.
    pub(super) fn new(devices: &[Device]) -> Result<Self> {
        let threads = (rayon::current_num_threads() / devices.len()).max(1);
        let pool = || {
            let built = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            built.map_err(|e| Error::input(format!("threads for {} devices: {e}", devices.len())))
        };
        let members = devices.iter().map(|device| Ok((device.clone(), pool()?))).collect::<Result<_>>()?;
        Ok(Self { members })
    }

    /// Runs `work` on each device with its part of `batches`. Returns gradients and figures in order, with the gradients on the first device.
    /// Afterwards, `net` has the means of the copies' running statistics.
    ///
    /// # Errors
    /// The first error of `work`.
    pub(super) fn work<B: Send, F: Send>(
        &self,
        net: &mut ELunarDtmNet,
        batches: Vec<B>,
        work: impl Fn(&ELunarDtmNet, Vec<B>) -> Result<(GradientsParams, F)> + Sync,
    ) -> Result<Vec<(GradientsParams, F)>> {
        let each = batches.len() / self.members.len();
        let mut batches = batches.into_iter();
        let mut jobs = Vec::new();
        for (device, pool) in &self.members {
            // By way of `valid`, because a plain copy of a module shares its running statistics.
            let copy = net.valid().train().fork(device);
            jobs.push((pool, copy, batches.by_ref().take(each).collect::<Vec<_>>()));
        }
        let work = &work;
        let done: Vec<Result<(_, Vec<Tensor<1>>)>> = std::thread::scope(|scope| {
            // All jobs start before the first result is awaited.
            let mut running = Vec::new();
            for (pool, copy, batches) in jobs {
                let job = move || Ok((work(&copy, batches)?, Buffers::of(&copy)));
                running.push(scope.spawn(move || pool.install(job)));
            }
            running.into_iter().map(|job| job.join().unwrap_or_else(|e| std::panic::resume_unwind(e))).collect()
        });
        let (mut found, mut buffers): (Vec<_>, Vec<_>) =
            done.into_iter().collect::<Result<Vec<_>>>()?.into_iter().unzip();
        let home = &self.members[0].0;
        for (gradients, _) in &mut found {
            *gradients = std::mem::take(gradients).to_device(home, net);
        }
        let means = mean(&mut buffers, home);
        *net = net.clone().map(&mut Settle { means: means.into_iter(), name: Vec::new() });
        Ok(found)
    }
}

/// Returns the means of lists of tensors, on a device.
fn mean(lists: &mut [Vec<Tensor<1>>], home: &Device) -> Vec<Tensor<1>> {
    let share = 1.0 / lists.len() as f64;
    let mut sums: Vec<Tensor<1>> = Vec::new();
    for list in lists {
        let list = list.drain(..).map(|t| t.to_device(home));
        sums =
            if sums.is_empty() { list.collect() } else { sums.into_iter().zip(list).map(|(a, b)| a.add(b)).collect() };
    }
    sums.into_iter().map(|sum| sum.mul_scalar(share)).collect()
}

/// Returns whether the tensor of this name is one of the running statistics.
fn is_running(name: &str) -> bool {
    name.starts_with("running_")
}

/// Running statistics in the network's order.
#[derive(Default)]
struct Buffers {
    name: Vec<String>,
    tensors: Vec<Tensor<1>>,
}

impl Buffers {
    fn of(net: &ELunarDtmNet) -> Vec<Tensor<1>> {
        // Applies pending statistics of the last forward pass.
        let _ = net.valid();
        let mut buffers = Self::default();
        net.visit(&mut buffers);
        buffers.tensors
    }
}

impl ModuleVisitor for Buffers {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.name.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.name.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if self.name.last().is_some_and(|name| is_running(name)) {
            self.tensors.push(param.val().reshape([-1]));
        }
    }
}

/// Replaces a network's running statistics.
struct Settle<I> {
    means: I,
    name: Vec<String>,
}

impl<I: Iterator<Item = Tensor<1>>> ModuleMapper for Settle<I> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.name.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.name.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if !self.name.last().is_some_and(|name| is_running(name)) {
            return param;
        }
        let shape = param.val().dims();
        match self.means.next() {
            Some(mean) => param.map(|_| mean.reshape(shape)),
            None => param,
        }
    }
}
