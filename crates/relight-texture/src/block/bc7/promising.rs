//! Which ways to part a block are worth trying: those whose subsets lie closest to lines, and short ones.

use super::modes::{Mode, Mode0, Mode1, Mode2, Mode3, parting_of, subset_in};
use crate::block::side_by_side::{LANES, Lanes, TEXELS, Texels, limited, spread};
use relight_core::Vectorized;

/// Most ways to part a block that are tried in a mode.
const MOST_TRIED: usize = 16;

/// Bits of a promise that hold the number of a way.
const NUMBERS: u32 = 63;

/// The least errors that may be hoped for, with the number of the way in their last bits; in modes 1, 3, 0 and 2, the smallest first,
/// infinite beyond those that are tried.
pub(super) type Promises = [[Lanes; MOST_TRIED]; 4];

/// The way to part a block that promises so much.
pub(super) fn partition_of(promise: f32) -> usize {
    (promise.to_bits() & NUMBERS) as usize
}

/// Finds the ways that promise most.
pub(super) struct Promising<'a> {
    pub(super) texels: &'a Texels,
    /// How many in each mode.
    pub(super) tried: [usize; 4],
    /// The part of what evenly spread values along a line lose that a promise has: ends suit the few texels that there are.
    pub(super) left: f32,
}

impl Vectorized for Promising<'_> {
    type Output = Promises;

    // Loops, as closures would be compiled without the level's instructions.
    #[inline(always)]
    fn run(self) -> Promises {
        let mut promises = [[[f32::INFINITY; LANES]; MOST_TRIED]; 4];
        let [of_1, of_3, of_0, of_2] = self.tried;
        let products = self.products();
        let (totals, _) = sums_of(&products, |_| true);
        let [for_1, for_3, for_0, for_2] = &mut promises;
        if of_1.max(of_3) > 0 {
            let lists = [&mut for_1[..of_1], &mut for_3[..of_3]];
            closest::<Mode1, Mode3>(&products, &totals, lists, self.left);
        }
        if of_0.max(of_2) > 0 {
            let lists = [&mut for_0[..of_0], &mut for_2[..of_2]];
            closest::<Mode0, Mode2>(&products, &totals, lists, self.left);
        }
        promises
    }
}

impl Promising<'_> {
    /// Of each texel: R, G, B and their products. In f32 about the block's mean, or squares would drown what varies.
    #[inline(always)]
    fn products(&self) -> [Products; TEXELS] {
        let mut products: [Products; TEXELS] = [[[0.0; LANES]; 9]; TEXELS];
        let mut means = [[0.0; LANES]; 3];
        for texel in self.texels {
            for c in 0..3 {
                for i in 0..LANES {
                    means[c][i] += texel[c][i] / TEXELS as f32;
                }
            }
        }
        for (texel, products) in self.texels.iter().zip(&mut products) {
            for i in 0..LANES {
                let [x, y, z] =
                    [texel[0][i] - means[0][i], texel[1][i] - means[1][i], texel[2][i] - means[2][i]];
                products[0][i] = x;
                products[1][i] = y;
                products[2][i] = z;
                products[3][i] = x * x;
                products[4][i] = x * y;
                products[5][i] = x * z;
                products[6][i] = y * y;
                products[7][i] = y * z;
                products[8][i] = z * z;
            }
        }
        products
    }
}

/// Fills the lists of two modes of as many subsets, the second with at least as many ways to part a block.
#[inline(always)]
fn closest<A: Mode, B: Mode>(
    products: &[Products; TEXELS],
    totals: &Products,
    mut lists: [&mut [Lanes]; 2],
    left: f32,
) {
    // What steps leave of the squares along a line of values that are spread evenly.
    let lefts = [A::STEPS, B::STEPS].map(|steps| left * (1.0 / (steps * steps) as f32));
    for partition in 0..B::PARTITIONS {
        let parting = parting_of::<B>(partition);
        let (mut beside, mut along) = ([0.0; LANES], [0.0; LANES]);
        let mut rest = *totals;
        let mut rest_count = TEXELS;
        for subset in 1..=B::SUBSETS {
            // The last subset is what is left.
            let mut sums = rest;
            let mut texels = rest_count;
            if subset < B::SUBSETS {
                let of_subset = |texel: usize| subset_in::<B>(parting, texel) == subset as u32;
                (sums, texels) = sums_of(products, of_subset);
                for (rest, sum) in rest.iter_mut().zip(&sums) {
                    for i in 0..LANES {
                        rest[i] -= sum[i];
                    }
                }
                rest_count -= texels;
            }
            spread(&moments_about_mean(&sums, texels), &mut beside, &mut along);
        }
        for ((list, left), count) in lists.iter_mut().zip(lefts).zip([A::PARTITIONS, B::PARTITIONS]) {
            if partition >= count {
                continue;
            }
            // The partition's number in the last bits of its promise: sorting one sorts both.
            let mut promise = [0.0; LANES];
            for i in 0..LANES {
                let error = limited(beside[i] + left * along[i], f32::MAX);
                promise[i] = f32::from_bits(error.to_bits() & !NUMBERS | partition as u32);
            }
            for least in list.iter_mut() {
                let (new, old) = (promise, *least);
                for i in 0..LANES {
                    least[i] = if new[i] < old[i] { new[i] } else { old[i] };
                }
                for i in 0..LANES {
                    promise[i] = if new[i] < old[i] { old[i] } else { new[i] };
                }
            }
        }
    }
}

/// Of a texel or of some: R, G, B and the products RR, RG, RB, GG, GB, BB.
type Products = [Lanes; 9];

/// The sums of some texels, and how many they are.
#[inline(always)]
fn sums_of(products: &[Products; TEXELS], is_in: impl Fn(usize) -> bool) -> (Products, usize) {
    let mut sums = [[0.0; LANES]; 9];
    let mut count = 0;
    for (texel, products) in products.iter().enumerate() {
        if !is_in(texel) {
            continue;
        }
        count += 1;
        for (sum, product) in sums.iter_mut().zip(products) {
            for i in 0..LANES {
                sum[i] += product[i];
            }
        }
    }
    (sums, count)
}

/// The moments xx, xy, xz, yy, yz, zz of `count` texels about their mean.
#[inline(always)]
fn moments_about_mean(sums: &Products, count: usize) -> [Lanes; 6] {
    let inverse = 1.0 / count as f32;
    let mut moments = [[0.0; LANES]; 6];
    for i in 0..LANES {
        let [x, y, z] = [sums[0][i], sums[1][i], sums[2][i]];
        moments[0][i] = sums[3][i] - x * x * inverse;
        moments[1][i] = sums[4][i] - x * y * inverse;
        moments[2][i] = sums[5][i] - x * z * inverse;
        moments[3][i] = sums[6][i] - y * y * inverse;
        moments[4][i] = sums[7][i] - y * z * inverse;
        moments[5][i] = sums[8][i] - z * z * inverse;
    }
    moments
}
