use nalgebra::DMatrix;
use relight_core::*;
use relight_core::sphere::*;
use relight_core::basis::FAMILIES;
use relight_fit::*;
#[test]
fn scan() {
    let mut worst: Vec<(f64, String)> = vec![];
    let mut sets: Vec<(String, Vec<Direction>)> = vec![];
    for n in [12usize, 24, 48, 60, 64, 96, 120, 150] {
        sets.push((format!("dome{n}"), fibonacci_in(Cap{axis:Direction::OUT,radius:1.45}, n)));
        sets.push((format!("sphere{n}"), fibonacci(n)));
        sets.push((format!("ham{n}"), hammersley(n,2)));
        for rings in [2usize,3,4,5] { if n % rings == 0 {
            let per = n/rings;
            sets.push((format!("rings{rings}x{per}"), (0..n).map(|i| Direction::from_azimuth_elevation((i%per) as f64*std::f64::consts::TAU/per as f64, 0.1+ 1.3*(i/per) as f64/rings as f64).unwrap()).collect()));
            let mut s = sets.last().unwrap().1.clone(); s.push(Direction::OUT);
            sets.push((format!("rings{rings}x{per}+pole"), s));
        }}
    }
    for (label, lights) in &sets {
        let set = LightSet::from_directions(lights.clone());
        for family in &FAMILIES { for count in family.counts_up_to(64) {
            if count > 16 && count % 5 != 0 && family.name=="srbf" {continue}
            let basis = family.build(&Design::new(count,&set)).unwrap();
            for w in [LightWeights::Uniform, LightWeights::Voronoi] {
                let d = Decomposition::new(&basis, lights, w).unwrap();
                let (n,k)=(lights.len(),count);
                let a = DMatrix::from_row_slice(n,k,&d.design);
                let wa = DMatrix::from_fn(n,k,|i,j| d.weights[i]*a[(i,j)]);
                let s0=d.singular_values[0];
                let ridge=1e-3;
                let s = DMatrix::from_row_slice(k,n,&d.solution(ridge));
                let g = a.transpose()*&wa + DMatrix::identity(k,k)*(ridge*s0*s0);
                let e = (&g*&s - wa.transpose()).abs().max()/wa.abs().max();
                let norm:f64 = d.singular_values.iter().map(|s|s*s).sum::<f64>() / (a.transpose()*&wa).trace() - 1.0;
                worst.push((e, format!("{label} {} {count} {w:?} rank {} cond {:.2} trace {norm:e}", family.name, d.rank(), d.condition())));
            }
        }}
    }
    worst.sort_by(|a,b| b.0.total_cmp(&a.0));
    println!("{} cases; above 1e-12: {}", worst.len(), worst.iter().filter(|w| w.0>1e-12).count());
    for w in worst.iter().take(40) { println!("{:e} {}", w.0, w.1); }
    println!("NaN {}", worst.iter().filter(|w| w.0.is_nan()).count());
}
