//! What a bake says for itself: a few lines on standard output, everything in `--report`.

use super::Stages;
use super::fit::{BakeFit, finite};
use super::job::{Job, Ready};
use super::kept::CacheUse;
use super::keys::key_of;
use super::positions::PositionFacts;
use super::textures::Plan;
use crate::budget::Budget;
use crate::evaluate::Evaluation;
use crate::failure::Failure;
use crate::say::{say, write_product};
use crate::{notes, page};
use relight_core::Model;
use relight_formats::{OpenCapture, hexadecimal};
use relight_texture::{PackReport, TexelFormat};
use serde_json::{Value, json};
use std::path::Path;

/// Everything that a report tells.
pub(super) struct Summary<'a> {
    pub(super) ready: &'a Ready<'a>,
    pub(super) fit: &'a BakeFit<'a>,
    /// What was taken from a cache, where there is one.
    pub(super) cache: Option<CacheUse>,
    pub(super) judged: Option<&'a Evaluation>,
    pub(super) budget: Option<&'a Budget>,
    pub(super) stages: &'a Stages,
    pub(super) spilled: u64,
    pub(super) model: &'a Model,
    pub(super) plan: &'a Plan,
    pub(super) packed: &'a PackReport,
    /// What is known of the positions, where some are stored.
    pub(super) positions: Option<&'a PositionFacts>,
}

/// What storing a plane cost.
struct PlaneCost {
    name: String,
    /// Root mean square error that it causes in relit pictures.
    relit_rmse: f64,
}

impl Summary<'_> {
    /// Prints notes and the main figures, and writes the reports and heat maps that are asked for.
    ///
    /// # Errors
    /// Those of writing.
    pub(super) fn tell(&self) -> Result<(), Failure> {
        let Ready { job, fitted, left_out, .. } = self.ready;
        let (output, heat_maps) = (job.arguments.output.as_path(), &job.arguments.heatmaps);
        self.print(output);
        if let Some((json, page)) = &job.report_files {
            let report = self.json(output);
            write_product(json, format!("{report:#}\n").as_bytes())?;
            if let Some(page) = page {
                let captures = (&fitted.select(&fitted.as_listed()), left_out.as_ref());
                page::write_bake_page(page, &report, output, captures, self.budget, &job.machine)?;
            }
        }
        match heat_maps.as_ref().zip(self.budget) {
            Some((folder, budget)) => budget.write_heat_maps(folder),
            None => Ok(()),
        }
    }

    /// The pictures that were fitted.
    fn fitted(&self) -> &OpenCapture {
        &self.ready.fitted
    }

    fn print(&self, output: &Path) {
        notes::print(&self.fit.notes);
        let fit = &self.fit.solved;
        say!(
            "{}: {} x {}, {}, {}, from {} pictures",
            output.display(),
            self.fitted().size().0,
            self.fitted().size().1,
            fit.words(),
            self.format_names(),
            self.fitted().infos.len()
        );
        let costs = self.costs();
        let worst = costs.iter().max_by(|a, b| a.relit_rmse.total_cmp(&b.relit_rmse));
        let worst = worst.map_or(String::new(), |worst| format!(", {} the most", worst.name));
        say!(
            "error of the fit {:.4}, of predicting each light from the others {:.4}, of storing {:.4}{worst} (rms, 0..1)",
            fit.figures().fit_rmse,
            fit.figures().leave_one_out_rmse,
            self.packed.relit_rmse,
        );
        if let Some(positions) = self.positions {
            say!("{}", positions.words);
        }
        if let Some(judged) = self.judged {
            say!("held out, {} pictures: {}", judged.pictures.len(), judged.mean_words());
        }
        self.budget.iter().flat_map(|budget| budget.lines()).for_each(|line| say!("{line}"));
        self.cache.iter().for_each(|cache| say!("{}", cache.words()));
        let total: f64 = self.stages.0.iter().map(|(_, seconds)| seconds).sum();
        let stages: Vec<_> =
            self.stages.summed().iter().map(|(name, seconds)| format!("{name} {seconds:.2}")).collect();
        say!("{total:.2} s: {}", stages.join(", "));
    }

    /// The formats of the textures, each once.
    fn format_names(&self) -> String {
        self.plan.packing.format_names().join(" and ")
    }

    /// What storing each plane cost, in the order of the model's planes.
    fn costs(&self) -> Vec<PlaneCost> {
        let names = relight_formats::plane_names(self.model);
        let planes = names.into_iter().zip(&self.packed.plane_relit_rmse);
        planes.map(|(name, &relit_rmse)| PlaneCost { name, relit_rmse }).collect()
    }

    /// Formats, ranges and costs of every map.
    fn storing(&self) -> Value {
        let costs = self.costs();
        let packing = &self.plan.packing;
        let mut maps = Vec::new();
        for (array, plan) in packing.arrays.iter().enumerate() {
            for (layer, plan_of_layer) in plan.layers.iter().enumerate() {
                for (channel, &plane) in plan_of_layer.planes.iter().enumerate() {
                    let quantizer = plan_of_layer.quantizers[channel];
                    maps.push(json!({
                        "name": costs[plane].name,
                        "array": array,
                        "layer": layer,
                        "channel": channel,
                        "format": plan.format.name(),
                        "scale": quantizer.scale,
                        "bias": quantizer.bias,
                        "clipped": self.plan.ranges[plane].clipped,
                        "rmse": self.packed.rmse[plane],
                        "relit_rmse": costs[plane].relit_rmse,
                    }));
                }
            }
        }
        json!({
            "formats": packing.formats().map(TexelFormat::name).collect::<Vec<_>>(),
            "layers": packing.layers(),
            "levels": packing.levels,
            "bits_per_pixel": packing.bits_per_pixel(),
            "relit_rmse": self.packed.relit_rmse,
            "maps": maps,
        })
    }

    /// The report as JSON.
    fn json(&self, output: &Path) -> Value {
        let (fit, Job { all, provenance, .. }) = (&self.fit.solved, &self.ready.job);
        let (figures, errors) = (fit.figures(), fit.leave_one_out());
        let weights = fit.weights();
        let names = &self.fitted().capture.lights.lights;
        // As the user's light file has them.
        let lights: Vec<Value> = self
            .fitted()
            .as_listed()
            .into_iter()
            .map(|i| {
                let light = &names[i];
                let misfit = self.fit.misfits.iter().find(|misfit| misfit.light == i);
                json!({
                    "name": light.name,
                    "direction": light.direction,
                    "weight": weights[i],
                    "leverage": errors.leverage[i],
                    "fit_rmse": errors.fit[i],
                    "leave_one_out_rmse": finite(errors.left_out[i]),
                    "misfit": misfit.is_some(),
                    "fits_better": misfit.and_then(|misfit| misfit.better).map(|other| names[other].name.as_str()),
                })
            })
            .collect();
        let stages: serde_json::Map<String, Value> = self
            .stages
            .summed()
            .into_iter()
            .map(|(name, seconds)| (name.to_owned(), json!(seconds)))
            .collect();
        let mut report = json!({
            "relight": env!("CARGO_PKG_VERSION"),
            "output": output.to_string_lossy(),
            "key": hexadecimal(&key_of(provenance)),
            "provenance": provenance,
            "cache": self.cache.map(CacheUse::json),
            "width": self.fitted().size().0,
            "height": self.fitted().size().1,
            "basis": self.model.basis,
            "functions": self.model.basis.count(),
            "precision": self.format_names(),
            "storing": self.storing(),
            "positions": self.positions.map(|positions| &positions.json),
            "fit_rmse": figures.fit_rmse,
            "leave_one_out_rmse": finite(figures.leave_one_out_rmse),
            "lights": lights,
            "holdout": self.judged.map(Evaluation::to_json),
            "error_budget": self.budget.map(Budget::to_json),
            "notes": all.capture.notes.iter().chain(&self.fit.notes).collect::<Vec<_>>(),
            "seconds": stages,
            "spilled_bytes": self.spilled,
        });
        if let (Some(report), Value::Object(solution)) = (report.as_object_mut(), fit.solution()) {
            report.extend(solution);
        }
        report
    }
}
