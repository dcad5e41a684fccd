// The stochastic program's backward sweep by hand: what ems/_sdp.py solves, as a C++ programmer would write it.
//
// Rows of the variance grid lie innermost, padded to whole vectors of eight doubles. All rows share the move
// along SOC, so nothing is gathered: a look-up is twelve multiply-adds of a vector of rows by a number.
//
//   per step:            distinct controls; the largest |i|, hence the least, middle and largest p' of each row
//   per (node, row):     cost-to-go at these three p', smoothed; the engine's next state; limited slopes; then
//                        value and slope as parabolas in y = beta h |i|, because p' = posterior + y
//   per (node, control): circuit, cost, cell, and the twelve weights (1, y, y^2) x (four of the cubic)
//   per (node, row, control): twelve multiply-adds, a sum and a minimum
//
// So the dependence on p' within one step is one parabola per (row, node); the naive kernel takes a parabola
// through the three rows nearest to every single p'.

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <vector>

namespace {

constexpr int LANES = 8;
constexpr long BLOCK = 64;  // controls whose weights are held at a time
typedef double Vector __attribute__((vector_size(8 * LANES)));
typedef long long Order __attribute__((vector_size(8 * LANES)));

struct Free {
    void operator()(void* memory) const { std::free(memory); }
};
using Memory = std::unique_ptr<Vector[], Free>;

Memory vectors(std::size_t count) {
    void* memory = nullptr;
    if (posix_memalign(&memory, 64, count * sizeof(Vector)) != 0) std::abort();
    std::memset(memory, 0, count * sizeof(Vector));
    return Memory(static_cast<Vector*>(memory));
}

inline Vector least(Vector a, Vector b) { return a < b ? a : b; }
inline Vector most(Vector a, Vector b) { return a > b ? a : b; }
inline Vector all(double x) { return Vector{} + x; }

}  // namespace

extern "C" {

struct Problem {
    long nodes, rows, steps, controls, reach, cubic;
    double soc_step, level_step, step_s, charge_to_soc, drift_per_A, start_cost_kg, shortfall_kg_per_J;
    const double *ocv_V, *discharge_ohm, *charge_ohm, *low_A, *high_A;  // (nodes)
    const double *level, *posterior;                                     // (rows), (rows, nodes)
    const long* taps;                                                    // (rows) to either side
    const double* weights;                                               // (rows, reach + 1, nodes), from the middle
    const double *cost_kg, *power_W;                                     // (steps, controls)
    const double *penalty_kg, *terminal_kg;                              // (rows, nodes)
    double* first;                                                       // (2, rows, nodes)
    double* seconds;                                                     // (4): circuit, smoothing, tables, look-ups
};
}

namespace {

double now_s() {
    timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

// What a step's controls do at the nodes; controls innermost, distinct ones only, "engine off" first.
struct Moves {
    long stride;
    std::vector<double> cost, y, part;  // (nodes, stride)
    std::vector<int> cell;
    std::vector<double> power, price;  // (stride)
    long count = 0;

    explicit Moves(const Problem& p)
        : stride((p.controls + LANES - 1) / LANES * LANES),
          cost(p.nodes * stride),
          y(p.nodes * stride),
          part(p.nodes * stride),
          cell(p.nodes * stride),
          power(stride),
          price(stride) {}

    double solve(const Problem& p, long k) {
        const double *cost_kg = p.cost_kg + k * p.controls, *power_W = p.power_W + k * p.controls;
        count = 0;
        for (long c = 0; c < p.controls; ++c) {
            if (c > 1 && power_W[c] == power_W[c - 1] && cost_kg[c] == cost_kg[c - 1]) continue;
            power[count] = power_W[c];
            price[count++] = cost_kg[c];
        }
        for (long c = count; c < stride; ++c) {
            power[c] = power[count - 1];
            price[c] = price[count - 1];
        }
        double largest = 0.0;
        const double per_A = p.charge_to_soc / p.soc_step, per_W = p.step_s * p.shortfall_kg_per_J;
        const long padded = (count + LANES - 1) / LANES * LANES;
        for (long j = 0; j < p.nodes; ++j) {
            const double ocv = p.ocv_V[j], discharge = p.discharge_ohm[j], charge = p.charge_ohm[j];
            const double low = p.low_A[j], high = p.high_A[j], lowest_W = low * (ocv + discharge * low);
            const double end = double(p.nodes - 1), at = double(j);
            double *to_cost = &cost[j * stride], *to_y = &y[j * stride], *to_part = &part[j * stride];
            int* to_cell = &cell[j * stride];
            const double *from_power = power.data(), *from_price = price.data();
#pragma GCC ivdep
            for (long c = 0; c < padded; ++c) {
                const double w = from_power[c], ohm = w < 0.0 ? discharge : charge;
                const double root = std::sqrt(std::max(ocv * ocv + 4.0 * ohm * w, 0.0));
                double i = 2.0 * w / (ocv + root);
                to_cost[c] = from_price[c] + (i < low ? (lowest_W - w) * per_W : 0.0);
                i = std::min(std::max(i, low), high);
                const double x = std::min(std::max(at + per_A * i, 0.0), end);
                const int whole = int(x);
                to_cell[c] = whole;
                to_part[c] = x - double(whole);
                const double size = std::abs(i);
                largest = std::max(largest, size);
                to_y[c] = p.drift_per_A * size;
            }
        }
        return largest;
    }
};

template <int H>  // vectors per node: rows / 8, rounded up
class Sweep {
    const Problem& p;
    const long n, wide;                // nodes, and nodes with the padding that smoothing needs on either side
    Memory after[2], copy[2][3];       // cost-to-go (n, H); the same at the three p' (wide, H)
    Memory weights, posterior, penalty;  // (n, reach + 1, H), (n, H), (n, H)
    Memory value[2][3], table[2];      // smoothed (n + 4, H); (n + 1, 6, H): value and slope, each 1, y, y^2
    long span[H];                      // taps of each vector of rows
    Order order[3][3][H];              // of each p': the three rows around it
    Vector near[3][3][H];              // and their weights
    Vector level[3][H], inverse[3][H];  // the p', and one over the products of their distances
    std::vector<double> lowest, highest;

  public:
    explicit Sweep(const Problem& problem)
        : p(problem), n(p.nodes), wide(p.nodes + 2 * p.reach) {
        weights = vectors(n * (p.reach + 1) * H);
        posterior = vectors(n * H);
        penalty = vectors(n * H);
        for (int e = 0; e < 2; ++e) {
            after[e] = vectors(n * H);
            table[e] = vectors((n + 1) * 6 * H);
            for (int m = 0; m < 3; ++m) {
                copy[e][m] = vectors(wide * H);
                value[e][m] = vectors((n + 4) * H);
            }
        }
        for (int h = 0; h < H; ++h) span[h] = 0;
        for (int lane = 0; lane < LANES * H; ++lane) {
            const long r = std::min<long>(lane, p.rows - 1), h = lane / LANES, l = lane % LANES;
            span[h] = std::max(span[h], p.taps[r]);
            const double* row = p.posterior + r * n;
            lowest.push_back(*std::min_element(row, row + n));
            highest.push_back(*std::max_element(row, row + n));
            for (long j = 0; j < n; ++j) {
                posterior[j * H + h][l] = row[j];
                penalty[j * H + h][l] = p.penalty_kg[r * n + j];
                after[0][j * H + h][l] = after[1][j * H + h][l] = p.terminal_kg[r * n + j];
                for (long t = 0; t <= p.reach; ++t)
                    weights[(j * (p.reach + 1) + t) * H + h][l] = p.weights[(r * (p.reach + 1) + t) * n + j];
            }
        }
    }

    void run() {
        Moves moves(p);
        double* seconds = p.seconds;
        for (long k = p.steps - 1; k >= 0; --k) {
            const double t0 = now_s();
            const double largest_A = moves.solve(p, k);
            const double t1 = now_s();
            choose_levels(p.drift_per_A * largest_A);
            smooth();
            const double t2 = now_s();
            tabulate();
            const double t3 = now_s();
            minimise(moves);
            const double t4 = now_s();
            seconds[0] += t1 - t0;
            seconds[1] += t2 - t1;
            seconds[2] += t3 - t2;
            seconds[3] += t4 - t3;
        }
        for (int e = 0; e < 2; ++e)
            for (long r = 0; r < p.rows; ++r)
                for (long j = 0; j < n; ++j)
                    p.first[(e * p.rows + r) * n + j] = after[e][j * H + r / LANES][r % LANES];
    }

  private:
    long first_level(double variance) const {
        return std::max(0L, std::min(long(std::sqrt(variance) / p.level_step - 0.5), p.rows - 3));
    }

    void choose_levels(double largest_y) {
        for (int lane = 0; lane < LANES * H; ++lane) {
            const int h = lane / LANES, l = lane % LANES;
            const double low = lowest[lane], high = highest[lane] + largest_y + 1e-12;
            const double at[3] = {low, 0.5 * (low + high), high};
            for (int m = 0; m < 3; ++m) {
                const long q = first_level(at[m]);
                const double* p = this->p.level + q;
                for (int d = 0; d < 3; ++d) {
                    const double a = p[(d + 1) % 3], b = p[(d + 2) % 3];
                    order[m][d][h][l] = q + d;
                    near[m][d][h][l] = (at[m] - a) * (at[m] - b) / ((p[d] - a) * (p[d] - b));
                }
                level[m][h][l] = at[m];
                inverse[m][h][l] = 1.0 / ((at[m] - at[(m + 1) % 3]) * (at[m] - at[(m + 2) % 3]));
            }
        }
    }

    static Vector rows_of(const Vector* from, const Order& order) {
        if constexpr (H == 1) return __builtin_shuffle(from[0], order);
        if constexpr (H == 2) return __builtin_shuffle(from[0], from[1], order);
        const double* rows = reinterpret_cast<const double*>(from);
        Vector found;
        for (int l = 0; l < LANES; ++l) found[l] = rows[order[l]];
        return found;
    }

    // Cost-to-go at the three p' of every row, constant beyond either end.
    void arrange() {
        for (long j = 0; j < n; ++j)
            for (int e = 0; e < 2; ++e)
                for (int m = 0; m < 3; ++m)
                    for (int h = 0; h < H; ++h) {
                        const Vector* from = &after[e][j * H];
                        copy[e][m][(p.reach + j) * H + h] = near[m][0][h] * rows_of(from, order[m][0][h]) +
                                                            near[m][1][h] * rows_of(from, order[m][1][h]) +
                                                            near[m][2][h] * rows_of(from, order[m][2][h]);
                    }
        for (int e = 0; e < 2; ++e)
            for (int m = 0; m < 3; ++m)
                for (long j = 0; j < p.reach; ++j)
                    for (int h = 0; h < H; ++h) {
                        Vector* to = copy[e][m].get();
                        to[j * H + h] = to[p.reach * H + h];
                        to[(p.reach + n + j) * H + h] = to[(p.reach + n - 1) * H + h];
                    }
    }

    void smooth() {
        arrange();
        const Vector start = all(p.start_cost_kg);
        for (long j = 0; j < n; ++j)
            for (int h = 0; h < H; ++h) {
                const Vector* w = &weights[j * (p.reach + 1) * H + h];
                const long middle = (p.reach + j) * H + h;
                Vector sum[2][3];
                for (int e = 0; e < 2; ++e)
                    for (int m = 0; m < 3; ++m) sum[e][m] = w[0] * copy[e][m][middle];
                for (long t = 1; t <= span[h]; ++t) {
                    const Vector weight = w[t * H];
                    for (int e = 0; e < 2; ++e)
                        for (int m = 0; m < 3; ++m)
                            sum[e][m] += weight * (copy[e][m][middle + t * H] + copy[e][m][middle - t * H]);
                }
                for (int m = 0; m < 3; ++m) {
                    const Vector off = sum[0][m], on = sum[1][m];
                    value[0][m][(j + 2) * H + h] = least(off, on + start);
                    value[1][m][(j + 2) * H + h] = least(off, on);
                }
            }
    }

    static Vector limited(Vector central, Vector below, Vector above) {
        const Vector zero = all(0.0), three = all(3.0);
        return least(most(central, least(zero, three * most(below, above))), most(zero, three * least(below, above)));
    }

    // Slope per cell at node j of smoothed values.
    Vector slope(const Vector* v, long j, int h) const {
        const Vector* at = v + (j + 2) * H + h;
        if (j == 0) return at[H] - at[0];
        if (j == n - 1) return at[0] - at[-H];
        const Vector below = at[0] - at[-H], above = at[H] - at[0];
        if (j == 1 || j == n - 2) return limited((above + below) * 0.5, below, above);
        return limited((at[-2 * H] - 8.0 * at[-H] + 8.0 * at[H] - at[2 * H]) * (1.0 / 12.0), below, above);
    }

    void tabulate() {
        for (long j = 0; j < n; ++j)
            for (int h = 0; h < H; ++h) {
                Vector x[3], share[3][3];
                for (int m = 0; m < 3; ++m) x[m] = posterior[j * H + h] - level[m][h];
                for (int m = 0; m < 3; ++m) {
                    const Vector a = x[(m + 1) % 3], b = x[(m + 2) % 3];
                    share[m][0] = inverse[m][h] * a * b;
                    share[m][1] = inverse[m][h] * (a + b);
                    share[m][2] = inverse[m][h];
                }
                for (int e = 0; e < 2; ++e) {
                    Vector v[3], s[3];
                    for (int m = 0; m < 3; ++m) {
                        v[m] = value[e][m][(j + 2) * H + h];
                        s[m] = slope(value[e][m].get(), j, h);
                    }
                    Vector* to = &table[e][j * 6 * H + h];
                    for (int d = 0; d < 3; ++d) {
                        to[d * H] = share[0][d] * v[0] + share[1][d] * v[1] + share[2][d] * v[2];
                        to[(3 + d) * H] = share[0][d] * s[0] + share[1][d] * s[1] + share[2][d] * s[2];
                    }
                }
            }
    }

    // Twelve weights of up to BLOCK controls at a node, controls innermost.
    void weigh(const double* part, const double* y, long count, double (*f)[BLOCK]) const {
        const double slopes = p.cubic ? 1.0 : 0.0;
#pragma GCC ivdep
        for (long c = 0; c < count; ++c) {
            const double t = part[c], r = 1.0 - t, a = y[c], b = a * a;
            const double w0 = r + slopes * t * r * (r - t), w1 = slopes * t * r * r;
            const double w2 = t - slopes * t * r * (r - t), w3 = -slopes * t * t * r;
            f[0][c] = w0, f[1][c] = w0 * a, f[2][c] = w0 * b;
            f[3][c] = w1, f[4][c] = w1 * a, f[5][c] = w1 * b;
            f[6][c] = w2, f[7][c] = w2 * a, f[8][c] = w2 * b;
            f[9][c] = w3, f[10][c] = w3 * a, f[11][c] = w3 * b;
        }
    }

    // Lower `best` by the controls first .. last - 1, which lead into the same cell: its table stays in registers.
    static void look_up(const Vector* at, const double (*f)[BLOCK], const double* cost, long first, long last,
                        Vector* best) {
        Vector held[12][H], lowest[H];
        for (int m = 0; m < 12; ++m)
            for (int h = 0; h < H; ++h) held[m][h] = at[m * H + h];
        for (int h = 0; h < H; ++h) lowest[h] = best[h];
        for (long c = first; c < last; ++c) {
            Vector sum[H];
            for (int h = 0; h < H; ++h) sum[h] = all(cost[c]);
            for (int m = 0; m < 12; ++m) {
                const Vector weight = all(f[m][c]);
                for (int h = 0; h < H; ++h) sum[h] += weight * held[m][h];
            }
            for (int h = 0; h < H; ++h) lowest[h] = least(lowest[h], sum[h]);
        }
        for (int h = 0; h < H; ++h) best[h] = lowest[h];
    }

    void minimise(const Moves& moves) {
        alignas(64) double f[12][BLOCK];
        for (long j = 0; j < n; ++j) {
            Vector best[2][H];
            for (int e = 0; e < 2; ++e)
                for (int h = 0; h < H; ++h) best[e][h] = all(1e300);
            for (long block = 0; block < moves.count; block += BLOCK) {
                const long at = j * moves.stride + block, count = std::min(moves.count - block, BLOCK);
                const double* cost = &moves.cost[at];
                const int* cell = &moves.cell[at];
                weigh(&moves.part[at], &moves.y[at], (count + LANES - 1) / LANES * LANES, f);
                if (block == 0) look_up(&table[0][cell[0] * 6 * H], f, cost, 0, 1, best[0]);
                for (long first = block == 0, last; first < count; first = last) {
                    for (last = first + 1; last < count && cell[last] == cell[first];) ++last;
                    look_up(&table[1][cell[first] * 6 * H], f, cost, first, last, best[1]);
                }
            }
            for (int e = 0; e < 2; ++e)
                for (int h = 0; h < H; ++h) after[e][j * H + h] = best[e][h] + penalty[j * H + h];
        }
    }
};

}  // namespace

extern "C" int sweep(const Problem* problem) {
    switch ((problem->rows + LANES - 1) / LANES) {
        case 1: Sweep<1>(*problem).run(); return 0;
        case 2: Sweep<2>(*problem).run(); return 0;
        case 3: Sweep<3>(*problem).run(); return 0;
        case 4: Sweep<4>(*problem).run(); return 0;
        case 5: Sweep<5>(*problem).run(); return 0;
        case 6: Sweep<6>(*problem).run(); return 0;
        default: return 1;
    }
}
