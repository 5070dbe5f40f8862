//! What hands a plan to an engine: one file each, the same for the same plan.

use super::PlanFile;
use crate::failure::Failure;
use clap::ValueEnum;
use serde_json::json;
use std::path::Path;

/// Engines that run the shards of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Engine {
    /// HyperQueue: a job file for `hq job submit-file`
    Hq,
    /// Slurm: a script for sbatch, with an array; merging depends on it
    Slurm,
    /// Open Job Description: a job template
    Openjd,
    /// Kubernetes: an indexed Job, and one that merges
    K8s,
    /// Ninja: a build file
    Ninja,
    /// Bazel: genrules of a BUILD file
    Bazel,
    /// A command a line
    Lines,
}

/// A plan as engines see it.
struct Submission<'a> {
    plan: &'a PlanFile,
    program: &'a str,
    /// Where the plan, its parts and the asset are.
    path: String,
    parts: String,
    output: String,
    name: String,
}

impl Engine {
    /// What such files are called after the plan's name.
    pub(super) fn extension(self) -> &'static str {
        match self {
            Self::Hq => "hq.toml",
            Self::Slurm => "slurm.sh",
            Self::Openjd => "openjd.json",
            Self::K8s => "k8s.yaml",
            Self::Ninja => "ninja",
            Self::Bazel => "BUILD.bazel",
            Self::Lines => "sh",
        }
    }

    /// How such a file is used.
    pub(super) fn about(self) -> &'static str {
        match self {
            Self::Hq => "hq job submit-file submits it",
            Self::Slurm => "sh submits it",
            Self::Openjd => "openjd run runs it, steps Shards and Merge",
            Self::K8s => "kubectl apply submits its two jobs, the second after the first",
            Self::Ninja => "ninja -f runs it",
            Self::Bazel => "a BUILD file; bazel build runs it",
            Self::Lines => "a command a line, the last after all others",
        }
    }

    /// The file for `plan`, which stands at `path`.
    ///
    /// # Errors
    /// Exit code 2 where names can't be written in such a file.
    pub(super) fn submission(self, plan: &PlanFile, path: &Path, program: &str) -> Result<String, Failure> {
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let words = |path: &Path| match path.to_str() {
            Some(text) if !text.contains(['\n', '\r']) => Ok(text.to_owned()),
            _ => Err(Failure::usage(format!(
                "{}: names with newlines or that are no UTF-8 can't be handed to an engine; rename it",
                path.display()
            ))),
        };
        let output = plan.job.get("output").cloned().unwrap_or_default();
        let stem = Path::new(&output).file_stem().and_then(|stem| stem.to_str()).unwrap_or("asset");
        let name: String = stem
            .chars()
            .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' })
            .collect();
        let submission = Submission {
            plan,
            program,
            path: words(&absolute)?,
            parts: words(&absolute.with_extension("parts"))?,
            output: words(Path::new(&output))?,
            name: format!("relight-{}", name.trim_matches('-')),
        };
        Ok(match self {
            Self::Hq => submission.hq(),
            Self::Slurm => submission.slurm(),
            Self::Openjd => submission.openjd()?,
            Self::K8s => submission.k8s(),
            Self::Ninja => submission.ninja(),
            Self::Bazel => submission.bazel(),
            Self::Lines => submission.lines(),
        })
    }
}

impl Submission<'_> {
    fn shards(&self) -> usize {
        self.plan.shards.len()
    }

    /// Words of a shard's command; `shard` is what stands after --shard.
    fn shard<'a>(&'a self, shard: &'a str) -> [&'a str; 8] {
        [self.program, "bake", "--plan", &self.path, "--shard", shard, "-o", &self.parts]
    }

    /// Words of the command that merges.
    fn merge(&self) -> [&str; 7] {
        [self.program, "merge", "--plan", &self.path, &self.parts, "-o", &self.output]
    }

    fn megabytes(bytes: u64) -> u64 {
        bytes.div_ceil(1 << 20)
    }

    /// The shards' peak, which is the same for all that have work.
    fn memory(&self) -> u64 {
        Self::megabytes(self.plan.shards[0].memory)
    }

    fn lines(&self) -> String {
        let shard = |index: usize| shell(&self.shard(&format!("{}/{}", index + 1, self.shards()))) + "\n";
        let shards: String = (0..self.shards()).map(shard).collect();
        format!("{shards}{}\n", shell(&self.merge()))
    }

    fn hq(&self) -> String {
        let array = |words: &[&str]| json!(words).to_string();
        let shards: String = (1..=self.shards())
            .map(|shard| {
                let of = format!("{shard}/{}", self.shards());
                format!("[[task]]\nid = {shard}\ncommand = {}\n\n", array(&self.shard(&of)))
            })
            .collect();
        let after: Vec<usize> = (1..=self.shards()).collect();
        format!(
            "# hq job submit-file this\nname = {}\n\n{shards}[[task]]\nid = {}\ndeps = {}\ncommand = {}\n",
            json!(self.name),
            self.shards() + 1,
            json!(after),
            array(&self.merge())
        )
    }

    fn slurm(&self) -> String {
        let Self { name, plan, .. } = self;
        format!(
            "#!/bin/sh\n\
             # sh this: submits the shards as an array, and merging after them.\n\
             set -e\n\
             shards=$(sbatch --parsable --job-name={name} --array=1-{} --cpus-per-task=1 --mem={}M --wrap {})\n\
             sbatch --parsable --job-name={name}-merge --dependency=afterok:\"$shards\" --mem={}M --wrap {}\n",
            self.shards(),
            self.memory(),
            quoted(&shell(&self.shard("auto"))),
            Self::megabytes(plan.merge.memory),
            quoted(&shell(&self.merge())),
        )
    }

    fn openjd(&self) -> Result<String, Failure> {
        let memory = |bytes: u64| json!([{ "name": "amount.worker.memory", "min": Self::megabytes(bytes) }]);
        let of = format!("{{{{Task.Param.Shard}}}}/{}", self.shards());
        let (shard, merge) = (self.shard(&of), self.merge());
        // Pairs of braces are expressions there, and nothing stands for a pair.
        let named = |word: &&&str| (word.contains("{{") || word.contains("}}")) && **word != of;
        if let Some(word) = shard.iter().chain(&merge).find(named) {
            return Err(Failure::usage(format!(
                "{word}: names with {{{{ or }}}} can't be written in a job template of Open Job Description; rename it"
            )));
        }
        let step = |name: &str, command: &[&str], bytes: u64| {
            json!({
                "name": name,
                "script": { "actions": { "onRun": { "command": command[0], "args": command[1..] } } },
                "hostRequirements": { "amounts": memory(bytes) },
            })
        };
        let mut shards = step("Shards", &shard, self.plan.shards[0].memory);
        shards["parameterSpace"] = json!({
            "taskParameterDefinitions": [{ "name": "Shard", "type": "INT", "range": format!("1-{}", self.shards()) }]
        });
        let mut merge = step("Merge", &merge, self.plan.merge.memory);
        merge["dependencies"] = json!([{ "dependsOn": "Shards" }]);
        let template = json!({ "specificationVersion": "jobtemplate-2023-09", "name": self.name, "steps": [shards, merge] });
        Ok(format!("{template:#}\n"))
    }

    fn k8s(&self) -> String {
        let job = |name: &str, command: &[&str], memory: u64, indexed: bool| {
            let mut job = json!({
                "apiVersion": "batch/v1",
                "kind": "Job",
                "metadata": { "name": name },
                "spec": {
                    "backoffLimit": 6,
                    "template": { "spec": {
                        "restartPolicy": "OnFailure",
                        "containers": [{
                            "name": "relight",
                            "image": "relight",
                            "command": command,
                            "resources": { "requests": { "cpu": "1", "memory": format!("{}Mi", Self::megabytes(memory)) } },
                            "volumeMounts": [{ "name": "work", "mountPath": "/work" }],
                        }],
                        "volumes": [{ "name": "work", "persistentVolumeClaim": { "claimName": "relight-work" } }],
                    } },
                },
            });
            if indexed {
                job["spec"]["completionMode"] = json!("Indexed");
                job["spec"]["completions"] = json!(self.shards());
                job["spec"]["parallelism"] = json!(self.shards());
            }
            job
        };
        let shards = job(&self.name, &self.shard("auto"), self.plan.shards[0].memory, true);
        let merge = job(&format!("{}-merge", self.name), &self.merge(), self.plan.merge.memory, false);
        // Every JSON document is YAML.
        format!(
            "# kubectl apply the first, wait for it (kubectl wait --for=condition=complete job/{}), apply the second.\n\
             {shards:#}\n---\n{merge:#}\n",
            self.name
        )
    }

    fn ninja(&self) -> String {
        let escaped = |text: &str| text.replace('$', "$$").replace(' ', "$ ").replace(':', "$:");
        let command = |words: &[&str]| shell(words).replace('$', "$$");
        let done = |shard: usize| format!("{}.{shard}-of-{}.done", self.parts, self.shards());
        let mut text = "rule relight\n  command = $command\n  description = relight $out\n\n".to_owned();
        let mut all = String::new();
        for shard in 1..=self.shards() {
            let stamp = done(shard);
            let of = format!("{shard}/{}", self.shards());
            let command = format!("{} && {}", command(&self.shard(&of)), command(&["touch", &stamp]));
            let stamp = escaped(&stamp);
            text += &format!("build {stamp}: relight {}\n  command = {command}\n", escaped(&self.path));
            all += &format!(" {stamp}");
        }
        let (output, command) = (escaped(&self.output), command(&self.merge()));
        text + &format!("build {output}: relight |{all}\n  command = {command}\ndefault {output}\n")
    }

    fn bazel(&self) -> String {
        let literal = |text: &str| json!(text).to_string();
        let command = |words: &[&str]| shell(words).replace('$', "$$");
        let mut text =
            "# Shards write beside the plan, on a disk that all actions see: they are no hermetic actions.\n"
                .to_owned();
        // The plan's key in a command makes it another one for another plan, which Bazel does not see otherwise.
        let key = &self.plan.key;
        let mut all = Vec::new();
        for shard in 1..=self.shards() {
            let name = format!("{}-{shard}", self.name);
            let of = format!("{shard}/{}", self.shards());
            let command = format!("{} && echo {key} >$@", command(&self.shard(&of)));
            text += &format!(
                "genrule(\n    name = {},\n    outs = [{}],\n    cmd = {},\n    tags = [\"local\"],\n)\n\n",
                literal(&name),
                literal(&format!("{name}.done")),
                literal(&command)
            );
            all.push(format!(":{name}"));
        }
        let command = format!("{} && echo {key} >$@", command(&self.merge()));
        text + &format!(
            "genrule(\n    name = {},\n    srcs = {},\n    outs = [{}],\n    cmd = {},\n    tags = [\"local\"],\n)\n",
            literal(&self.name),
            json!(all),
            literal(&format!("{}.done", self.name)),
            literal(&command)
        )
    }
}

/// Words as a POSIX shell takes them.
fn shell(words: &[&str]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// A word as a POSIX shell takes it.
pub(crate) fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@%".contains(c);
    match !word.is_empty() && word.chars().all(plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}
