"""The library's forces in newtons, in laws of the user's."""

import softjax as sj


class Borrowed(sj.RateIndependentLaw):
    contact: sj.Contact
    law: sj.RateIndependentLaw

    def elastic_overlap(self):
        if not isinstance(self.law, sj.Zhou | sj.Thornton):
            return 0.0
        impact = 1.25 * self.contact.mass * self.law.elastic_velocity() ** 2
        return (impact / self.contact.stiffness) ** 0.4

    def loading_force(self, overlap):
        return self.law.loading_force(overlap)

    def unloading_force(self, overlap, peak_overlap):
        return self.law.unloading_force(overlap, peak_overlap)
