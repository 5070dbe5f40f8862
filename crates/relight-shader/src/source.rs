//! Source text in the making: declarations, tables, functions and loops in the words of a language.

use crate::Language;
use crate::language::{Type, Typed};
use std::fmt;
use std::ops::Range;

/// Columns that a table's rows fill.
const COLUMNS: usize = 110;

/// What a parameter takes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Takes {
    Value(Type),
    /// So many (a number or a constant's name) of a type.
    Array(Type, &'static str),
    Texture,
    Sampler,
}

/// A parameter of a function.
#[derive(Clone, Debug)]
pub(crate) struct Parameter {
    pub(crate) name: String,
    pub(crate) takes: Takes,
}

impl Parameter {
    pub(crate) fn new(name: impl Into<String>, takes: Takes) -> Self {
        Self { name: name.into(), takes }
    }

    pub(crate) fn value(name: &str, of: Type) -> Self {
        Self::new(name, Takes::Value(of))
    }
}

/// Where in an array a statement is.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Index {
    Number(usize),
    Variable(&'static str),
}

impl Index {
    /// So much less.
    pub(crate) fn minus(self, number: usize) -> String {
        match self {
            Self::Number(index) => (index - number).to_string(),
            Self::Variable(name) if number == 0 => name.to_owned(),
            Self::Variable(name) => format!("({name} - {number})"),
        }
    }
}

impl fmt::Display for Index {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(index) => write!(f, "{index}"),
            Self::Variable(name) => write!(f, "{name}"),
        }
    }
}

/// Lines of source, indented.
#[derive(Debug)]
pub(crate) struct Source {
    pub(crate) language: Language,
    text: String,
    depth: usize,
}

impl Source {
    pub(crate) fn new(language: Language) -> Self {
        Self { language, text: String::new(), depth: 0 }
    }

    pub(crate) fn into_text(self) -> String {
        self.text
    }

    pub(crate) fn line(&mut self, line: &str) {
        if !line.is_empty() {
            self.text.push_str(&"    ".repeat(self.depth));
            self.text.push_str(line);
        }
        self.text.push('\n');
    }

    /// An empty line, then a comment that belongs to what follows.
    pub(crate) fn comment(&mut self, text: &str) {
        if self.depth == 0 && !self.text.is_empty() {
            self.line("");
        }
        for line in text.lines() {
            self.line(format!("// {line}").trim_end());
        }
    }

    pub(crate) fn word(&self, of: Type) -> &'static str {
        self.language.word(of)
    }

    /// `x: f32` or `float x`.
    fn typed(&self, name: &str, word: &str) -> String {
        match self.language.typed() {
            Typed::After => format!("{name}: {word}"),
            Typed::Before => format!("{word} {name}"),
        }
    }

    fn typed_array(&self, name: &str, of: Type, len: &str) -> String {
        let word = self.word(of);
        match self.language.typed() {
            Typed::After => format!("{name}: array<{word}, {len}>"),
            Typed::Before => format!("{word} {name}[{len}]"),
        }
    }

    fn parameters(&self, parameters: &[Parameter]) -> String {
        let words = parameters.iter().filter_map(|parameter| {
            let name = &parameter.name;
            match parameter.takes {
                Takes::Value(of) => Some(self.typed(name, self.word(of))),
                Takes::Array(of, len) => Some(self.typed_array(name, of, len)),
                Takes::Texture => Some(self.typed(name, self.language.texture())),
                Takes::Sampler => self.language.sampler().map(|word| self.typed(name, word)),
            }
        });
        words.collect::<Vec<_>>().join(", ")
    }

    /// A number with a name, for all functions.
    pub(crate) fn constant(&mut self, of: Type, name: &str, value: &str) {
        let line = format!("{} {} = {value};", self.language.constant(), self.typed(name, self.word(of)));
        self.line(&line);
    }

    /// Constants that statements find by [`element`](Self::element): an array, or a constant each in a
    /// language that [unrolls](Self::unrolls). `rows` are numbers, or components separated by commas.
    pub(crate) fn table(&mut self, of: Type, name: &str, rows: &[String]) {
        if !self.unrolls() {
            return self.table_as(self.language.constant(), of, name, rows);
        }
        let word = self.word(of);
        for (i, row) in rows.iter().enumerate() {
            self.line(&format!("const {name}_{i} = {word}({row});"));
        }
    }

    /// The constant of a [`table`](Self::table) at `index`.
    pub(crate) fn element(&self, table: &str, index: Index) -> String {
        match index {
            Index::Number(number) => format!("{table}_{number}"),
            Index::Variable(name) => format!("{table}[{name}]"),
        }
    }

    /// An array that is indexed by variables in every language.
    pub(crate) fn indexed_table(&mut self, of: Type, name: &str, rows: &[String]) {
        let kind = if self.unrolls() { "var<private>" } else { self.language.constant() };
        self.table_as(kind, of, name, rows);
    }

    fn table_as(&mut self, kind: &str, of: Type, name: &str, rows: &[String]) {
        let (word, len) = (self.word(of), rows.len());
        let (open, close) = match self.language {
            Language::Wgsl => (format!("{kind} {name} = array<{word}, {len}>("), ");"),
            Language::Glsl => (format!("{kind} {word} {name}[{len}] = {word}[{len}]("), ");"),
            Language::Hlsl => (format!("{kind} {word} {name}[{len}] = {{"), "};"),
        };
        self.line(&open);
        self.depth += 1;
        let mut line = String::new();
        for (i, row) in rows.iter().enumerate() {
            let scalar = matches!(of, Type::Int | Type::Float);
            let value = if scalar { row.clone() } else { format!("{word}({row})") };
            // GLSL and HLSL take no comma after the last.
            let value = value + if i + 1 < len { "," } else { "" };
            if !line.is_empty() && line.len() + value.len() + 5 > COLUMNS {
                self.line(&std::mem::take(&mut line));
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(&value);
        }
        self.line(&line);
        self.depth -= 1;
        self.line(close);
    }

    /// A function that returns a value.
    pub(crate) fn function(
        &mut self,
        returns: Type,
        name: &str,
        parameters: &[Parameter],
        body: impl FnOnce(&mut Self),
    ) {
        let (word, parameters) = (self.word(returns), self.parameters(parameters));
        let head = match self.language.typed() {
            Typed::After => format!("fn {name}({parameters}) -> {word}"),
            Typed::Before => format!("{word} {name}({parameters})"),
        };
        self.block(&head, body);
    }

    /// A function that makes `len` of `of` as the array `makes`, its value or its last parameter.
    pub(crate) fn array_function(
        &mut self,
        (of, len, makes): (Type, &str, &str),
        name: &str,
        parameters: &[Parameter],
        body: impl FnOnce(&mut Self),
    ) {
        let (word, parameters) = (self.word(of), self.parameters(parameters));
        match self.language.typed() {
            Typed::After => {
                self.block(&format!("fn {name}({parameters}) -> array<{word}, {len}>"), |source| {
                    source.array(of, len, makes);
                    body(source);
                    source.line(&format!("return {makes};"));
                });
            }
            Typed::Before => {
                let made = self.typed_array(makes, of, len);
                self.block(&format!("void {name}({parameters}, out {made})"), body);
            }
        }
    }

    /// A local array without values.
    pub(crate) fn array(&mut self, of: Type, len: &str, name: &str) {
        let array = self.typed_array(name, of, len);
        self.line(&match self.language.typed() {
            Typed::After => format!("var {array};"),
            Typed::Before => format!("{array};"),
        });
    }

    /// Fills the local array `target` by an array function.
    pub(crate) fn fill(&mut self, target: &str, function: &str, argument: &str) {
        self.line(&match self.language.typed() {
            Typed::After => format!("{target} = {function}({argument});"),
            Typed::Before => format!("{function}({argument}, {target});"),
        });
    }

    /// A local name for a value.
    pub(crate) fn value(&mut self, of: Type, name: &str, value: &str) {
        self.line(&self.value_statement(of, name, value));
    }

    pub(crate) fn value_statement(&self, of: Type, name: &str, value: &str) -> String {
        match self.language.typed() {
            Typed::After => format!("let {name} = {value};"),
            Typed::Before => format!("{} {name} = {value};", self.word(of)),
        }
    }

    /// A local variable.
    pub(crate) fn variable(&mut self, of: Type, name: &str, value: &str) {
        let typed = self.typed(name, self.word(of));
        self.line(&match self.language.typed() {
            Typed::After => format!("var {typed} = {value};"),
            Typed::Before => format!("{typed} = {value};"),
        });
    }

    /// Whether loops over arrays are written out.
    ///
    /// WGSL's arrays are values, and naga copies a whole one at each access by a variable index, once a
    /// turn (and constant ones into the syntax tree at each access by a constant index): 128 layers in a loop took 228 s to compile and 36 s to shade 65,536 texels on lavapipe,
    /// 7 s and 5 s written out (two busy cores). Compilers of GLSL and HLSL index constants and parameters in place.
    pub(crate) fn unrolls(&self) -> bool {
        self.language == Language::Wgsl
    }

    /// Statements for each of `range`: a loop over the variable `name`, or written out.
    pub(crate) fn each_of(
        &mut self,
        name: &'static str,
        range: Range<usize>,
        statements: impl Fn(&Self, Index) -> Vec<String>,
    ) {
        if self.unrolls() {
            for number in range {
                match &statements(self, Index::Number(number))[..] {
                    [one] => self.line(one),
                    several => self.line(&format!("{{ {} }}", several.join(" "))),
                }
            }
        } else {
            let (first, end) = (range.start.to_string(), range.end.to_string());
            self.each(name, &first, &end, |source| {
                let statements = statements(source, Index::Variable(name));
                statements.iter().for_each(|statement| source.line(statement));
            });
        }
    }

    /// The body for each `index` from `first` up to but without `end`.
    pub(crate) fn each(&mut self, index: &str, first: &str, end: &str, body: impl FnOnce(&mut Self)) {
        let declared = match self.language.typed() {
            Typed::After => "var",
            Typed::Before => self.word(Type::Int),
        };
        self.block(&format!("for ({declared} {index} = {first}; {index} < {end}; {index}++)"), body);
    }

    /// A head and a body in braces.
    pub(crate) fn block(&mut self, head: &str, body: impl FnOnce(&mut Self)) {
        self.line(&format!("{head} {{"));
        self.depth += 1;
        body(self);
        self.depth -= 1;
        self.line("}");
    }

    /// An expression: `yes` where the condition holds, else `no`.
    pub(crate) fn choice(&self, condition: &str, yes: &str, no: &str) -> String {
        match self.language {
            Language::Wgsl => format!("select({no}, {yes}, {condition})"),
            Language::Glsl | Language::Hlsl => format!("{condition} ? {yes} : {no}"),
        }
    }
}
