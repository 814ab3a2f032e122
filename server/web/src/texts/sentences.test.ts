import { describe, expect, it } from "vitest";
import { REPORT_FIXED, REPORT_SENTENCES } from "./report_de";
import { translated } from "./sentences";
import { SERVICE_FIXED, SERVICE_SENTENCES } from "./service_de";

const german = translated({ ...REPORT_FIXED, ...SERVICE_FIXED }, [...SERVICE_SENTENCES, ...REPORT_SENTENCES]);

describe("sentences of the service", () => {
  it("keep names and get the decimal sign of the language", () => {
    expect(german("no measurement from joint1.angle, joint2.angle; check the sensor and its cable")).toBe(
      "Keine Messung von joint1.angle, joint2.angle; den Aufnehmer und sein Kabel prüfen",
    );
    expect(
      german(
        "joint2: measured and predicted effort differ by +12.5 N m, 7.3 times the band (limit 4.1): a collision or an overload; look at the arm",
      ),
    ).toBe(
      "joint2: gemessene und vorhergesagte Kraft unterscheiden sich um +12,5 N m, das 7,3-Fache des Bands (Grenze 4,1): Kollision oder Überlast; den Arm ansehen",
    );
  });

  it("look up what stands in them, also in lists and behind a joint's name", () => {
    expect(
      german(
        "measured and predicted effort drift apart: joint1: a constant force more or less; joint3: more or less force against the motion (friction); recalibrate, or look for the cause",
      ),
    ).toBe(
      "Gemessene und vorhergesagte Kraft laufen auseinander: joint1: eine gleichbleibende Kraft mehr oder weniger; joint3: mehr oder weniger Kraft gegen die Bewegung (Reibung); neu kalibrieren oder die Ursache suchen",
    );
    expect(german("Stage 1: each drive's friction and stiffness: failed")).toBe(
      "Stufe 1: Reibung und Steifigkeit jedes Antriebs: fehlgeschlagen",
    );
  });

  it("stay as they are where no table has them", () => {
    expect(german("bus 'can': no such interface 'can7'")).toBe("bus 'can': no such interface 'can7'");
  });
});
