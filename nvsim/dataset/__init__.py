"""Export projects as a VLN dataset: scans, features, tasks with instructions and landmarks, and baseline results. This
package does not depend on the command line."""
