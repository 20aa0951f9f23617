/** Fingers for the simulated hand, and what it can hold. */

export { ARMS_APART, KEY_SPACING, KEY_Y, LEAP_REST, handPlace, isLeap, lostToLeap } from "./places";
export { releaseEarly } from "./releases";
