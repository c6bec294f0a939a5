"""Columns are what their names spell, and a row below the header is of units only if it holds one."""

import pytest

import calibration as cal


@pytest.fixture
def read(tmp_path):
    """Data of a CSV file with these lines."""

    def read(*lines):
        (tmp_path / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return cal.read_csv(tmp_path / "a.csv")

    return read


ROWS = ("1,0.9,0.5", "2,0.8,0.5", "3,0.7,0.5")


@pytest.mark.parametrize("name", ["EU", "TU", "vu", "ut", "ue", "e_u", "Su", "sdv", "estd"])
def test_letters_that_stand_together_spell_no_uncertainty(name, read):
    """EU is a region, TU a university: fails where 0.5 becomes an uncertainty of ε or of v."""
    data = read(f"v [m/s],e,{name}", *ROWS)
    assert (data.uncertainty, data.velocity_uncertainty) == (None, None)
    assert any(f"columns not used: {name!r}" in remark for remark in data.remarks)


@pytest.mark.parametrize("name", ["u_e", "u(e)", "e_err", "±e", "std of COR", "restitution sd"])
def test_documented_spellings_of_the_uncertainty_of_restitution(name, read):
    assert read(f"v [m/s],e,{name}", *ROWS).uncertainty.tolist() == [0.5] * 3


@pytest.mark.parametrize("name", ["u_v [m/s]", "v_err", "σ_v", "error of velocity (m/s)"])
def test_documented_spellings_of_the_uncertainty_of_velocity(name, read):
    assert read(f"v [m/s],e,{name}", *ROWS).velocity_uncertainty.tolist() == [0.5] * 3


@pytest.mark.parametrize("missing", ["NA", "N/A", "missing"])
@pytest.mark.parametrize("header", ["v,e", "velocity [m/s],restitution"])
def test_a_first_row_of_missing_values_is_no_row_of_units(header, missing, read, tmp_path):
    with pytest.raises(ValueError, match="it must be a finite number") as caught:
        read(header, f"{missing},{missing}", "1,0.9", "2,0.8")
    assert str(caught.value).startswith(f"{tmp_path}/a.csv:2: velocity is '{missing}'")


@pytest.mark.parametrize("units", ["cm/s,-", "cm/s,", "[cm/s],[-]"])
def test_a_row_of_units_is_one(units, read):
    assert read("v,e", units, "100,0.9", "200,0.8").velocity.tolist() == [1.0, 2.0]
